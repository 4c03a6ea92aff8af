// What went wrong, what the picture lacks, and what the server chose by itself.

import { el } from "./dom.js";

function pointed(pointer, detail) {
  return el("li", {}, pointer ? el("code", {}, pointer) : null, pointer ? " " : null, detail);
}

/** A pointed list says the same as the detail when there is one place only. */
function places(errors, detail) {
  const more = errors.filter((error) => error.detail !== detail || error.pointer);
  return more.length > 0 ? el("ul", {}, ...more.map((error) => pointed(error.pointer, error.detail))) : null;
}

export class Notices {
  /** `alert`: element for errors (role alert); `notes`: element for warnings and defaults. */
  constructor(alert, notes) {
    this.alert = alert;
    this.notes = notes;
  }

  /** A Problem, or any Error. */
  error(problem) {
    const errors = problem.errors ?? [];
    const title = problem.title ?? "That did not work";
    const close = el(
      "button",
      { type: "button", class: "quiet", "aria-label": "Close this message", onclick: () => this.clearError() },
      "✕",
    );
    const repeats = errors.length > 0 && problem.message.includes(errors[0].detail);
    const body = el(
      "div",
      {},
      el("strong", {}, title),
      repeats ? null : el("p", {}, problem.message),
      places(errors, problem.message),
    );
    this.alert.replaceChildren(body, close);
    this.alert.hidden = false;
  }

  clearError() {
    this.alert.hidden = true;
    this.alert.replaceChildren();
  }

  /** `warnings`: `[{code, pointer, detail}]`; `biases`: sentences; `defaults`: `[{what, value}]`. */
  report({ warnings = [], biases = [], defaults = [] }) {
    const groups = [
      ["Warnings", warnings.map(({ pointer, detail }) => pointed(pointer, detail))],
      ["Biases", biases.map((text) => pointed("", text))],
      [
        "Chosen for you",
        defaults.map(({ what, value }) => pointed(what, typeof value === "string" ? value : JSON.stringify(value))),
      ],
    ].filter(([, items]) => items.length > 0);
    const lists = groups.map(([name, items]) =>
      el(
        "details",
        { open: name === "Warnings" },
        el("summary", {}, `${name} (${items.length})`),
        el("ul", {}, ...items),
      ),
    );
    this.notes.replaceChildren(...lists);
    this.notes.hidden = groups.length === 0;
  }
}
