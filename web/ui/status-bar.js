// How the render goes: a bar, the numbers, and one line of words that screen readers hear.

import { ErrorPlot } from "./error-plot.js";

const percent = (x) => `${(x * 100).toPrecision(2)} %`;
const STOPS = { max_samples: "all samples taken", target_error: "target error reached", deadline: "time is up" };

const LOST = "Connection lost, trying again";

/** A span of time for people. */
function duration(seconds) {
  if (seconds < 1) return `${Math.round(seconds * 1000)} ms`;
  if (seconds < 60) return `${seconds.toFixed(1)} s`;
  return `${Math.floor(seconds / 60)} min ${Math.round(seconds % 60)} s`;
}

/** Seconds of all stages together. */
const total = (seconds) => Object.values(seconds).reduce((a, b) => a + b, 0);

function errorText(error, bound) {
  if (error === null || error === undefined) return "–";
  return bound === null || bound === undefined ? percent(error) : `${percent(error)} (95 %: ≤ ${percent(bound)})`;
}

export class StatusBar {
  #started = 0;
  #clock = null;
  #beforeLoss = "";

  /** `element` holds `.words`, a `progress`, `.cancel`, the numbers by `data-number` and the plot in `.convergence`. */
  constructor(element, onCancel) {
    this.words = element.querySelector(".words");
    this.bar = element.querySelector("progress");
    this.cancelButton = element.querySelector(".cancel");
    this.cancelButton.addEventListener("click", onCancel);
    this.numbers = Object.fromEntries(
      [...element.querySelectorAll("[data-number]")].map((node) => [node.dataset.number, node]),
    );
    this.plot = new ErrorPlot(element.querySelector(".convergence"));
    this.root = element;
  }

  /** Words only; `busy`: with a bar that does not know how far it is. */
  say(words, { busy = false } = {}) {
    this.#tell(words);
    this.#run(busy, null);
  }

  /** Words about something beside the render; answers what takes them back, with other words if nothing is rendered. */
  aside(words) {
    const before = this.words.textContent;
    const rendering = this.root.classList.contains("running");
    if (rendering) this.#tell(words);
    else this.say(words, { busy: true });
    return (instead) => {
      if (this.words.textContent !== words) return;
      if (rendering) this.#tell(before);
      else this.say(instead);
    };
  }

  /** A draft is asked for: what was measured of the picture before it no longer holds. */
  draft() {
    if (this.words.textContent === "Draft") return;
    this.say("Draft");
    this.plot.begin();
    this.#write({ samples: "–", error: "–", time: "–" });
  }

  /** A draft is on screen. */
  drafted(report) {
    if (this.words.textContent !== "Draft") return;
    this.#write({ samples: String(report.samples), time: duration(total(report.seconds)), device: report.device.name });
  }

  /** The server could not, and is asked again. */
  waiting(why, seconds, tries, most) {
    this.say(`${why}: try ${tries + 1} of ${most} in ${duration(seconds)}`, { busy: true });
    this.cancelButton.disabled = false;
  }

  begin() {
    this.#started = performance.now();
    this.plot.begin();
    this.#tell("Rendering");
    this.#write({ samples: "–", error: "–", time: duration(0) });
    this.#run(true, null);
    this.#clock = setInterval(() => this.#write({ time: duration((performance.now() - this.#started) / 1000) }), 100);
    this.cancelButton.disabled = false;
  }

  /** So many older jobs wait, too. */
  queued(before) {
    this.#tell(before === 0 ? "Queued: next" : `Queued: ${before} before it`);
  }

  /** Whether news of the render can come. */
  connected(whether) {
    const lost = this.words.textContent === LOST;
    if (whether === !lost) return;
    if (!whether) this.#beforeLoss = this.words.textContent;
    this.#tell(whether ? this.#beforeLoss : LOST);
  }

  progress({ fraction, samples, error, error_bound_95: bound, eta_seconds: eta }) {
    this.#write({ samples: String(samples), error: errorText(error, bound) });
    this.plot.add((performance.now() - this.#started) / 1000, error);
    this.bar.value = fraction;
    this.bar.title = eta === null || eta === undefined ? "" : `about ${duration(eta)} left`;
  }

  started({ device }) {
    this.#tell("Rendering");
    this.#write({ device });
  }

  /** The numbers of a finished render: time is the server's, from queue to file. `cached`: it is one of before. */
  done(report, cached) {
    const { seconds } = report;
    const time = total(seconds);
    this.plot.add(time, report.error);
    this.#run(false, 1);
    this.#tell(`Done: ${STOPS[report.stop_reason] ?? report.stop_reason}${cached ? " (kept from before)" : ""}`);
    this.#write({
      samples: String(report.samples),
      error: errorText(report.error, report.error_bound_95),
      time: duration(time),
      device: report.device.name,
    });
    const { samples_min: least, samples_max: most } = report;
    this.numbers.samples.title = least < most ? `${least} to ${most}` : "";
    this.numbers.time.title = Object.entries(seconds)
      .map(([stage, s]) => `${stage}: ${duration(s)}`)
      .join("\n");
  }

  /** Written only when new, so that screen readers do not hear it again. */
  #tell(words) {
    if (this.words.textContent !== words) this.words.textContent = words;
  }

  #run(running, fraction) {
    clearInterval(this.#clock);
    this.root.classList.toggle("running", running);
    if (fraction === null) this.bar.removeAttribute("value");
    else this.bar.value = fraction;
    this.cancelButton.disabled = true;
  }

  #write(numbers) {
    for (const [name, text] of Object.entries(numbers)) this.numbers[name].textContent = text;
  }
}
