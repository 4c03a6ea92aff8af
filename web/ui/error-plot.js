// Error against time while a render converges, both logarithmic: independent samples fall by half when time is four times as long.

const SVG = "http://www.w3.org/2000/svg";
/** Of the drawing, with room for the numbers at the left and below. */
const BOX = { left: 44, right: 378, top: 8, bottom: 98 };

function shape(name, attributes, text = "") {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.textContent = text;
  return element;
}

/** Powers of ten around some positive numbers, at least one decade. */
function decades(values) {
  const low = Math.floor(Math.log10(Math.min(...values)));
  return [low, Math.max(low + 1, Math.ceil(Math.log10(Math.max(...values))))];
}

const NOTHING = "Nothing measured yet";

const percent = (x) => `${Number((x * 100).toPrecision(2))} %`;
const seconds = (x) => `${Number(x.toPrecision(2))} s`;

export class ErrorPlot {
  #points = [];

  /** `element` holds an `svg`, and is hidden until there is something to see. */
  constructor(element) {
    this.element = element;
    this.svg = element.querySelector("svg");
  }

  /** A new render. What was drawn goes; its room stays, so that nothing below it jumps. */
  begin() {
    this.#points = [];
    this.svg.setAttribute("aria-label", NOTHING);
    this.svg.replaceChildren(shape("text", { x: BOX.left, y: (BOX.top + BOX.bottom) / 2 }, NOTHING));
  }

  /** What was measured after a time in seconds. */
  add(time, error) {
    if (!(time > 0 && error > 0)) return;
    this.#points.push([time, error]);
    this.element.hidden = false;
    this.#draw();
  }

  #draw() {
    const [times, errors] = [0, 1].map((i) => this.#points.map((point) => point[i]));
    const across = this.#axis(decades(times), [BOX.left, BOX.right]);
    const down = this.#axis(decades(errors), [BOX.bottom, BOX.top]);
    const line = this.#points.map(([time, error]) => `${across.place(time)},${down.place(error)}`).join(" ");
    const [time, error] = this.#points.at(-1);
    this.svg.setAttribute("aria-label", `Error ${percent(error)} after ${seconds(time)}`);
    this.svg.replaceChildren(
      ...across.ticks.flatMap(({ at, value }) => [
        shape("path", { d: `M${at} ${BOX.top}V${BOX.bottom}`, class: "grid" }),
        shape("text", { x: at, y: BOX.bottom + 15, "text-anchor": "middle" }, seconds(value)),
      ]),
      ...down.ticks.flatMap(({ at, value }) => [
        shape("path", { d: `M${BOX.left} ${at}H${BOX.right}`, class: "grid" }),
        shape("text", { x: BOX.left - 6, y: at + 4, "text-anchor": "end" }, percent(value)),
      ]),
      shape("polyline", { points: line }),
      shape("circle", { cx: across.place(time), cy: down.place(error), r: 3 }),
    );
  }

  /** `place(x)` in the drawing, and a tick at each power of ten. */
  #axis([low, high], [start, end]) {
    const place = (x) => start + ((Math.log10(x) - low) / (high - low)) * (end - start);
    const ticks = Array.from({ length: high - low + 1 }, (_, i) => 10 ** (low + i));
    return { place, ticks: ticks.map((value) => ({ at: place(value), value })) };
  }
}
