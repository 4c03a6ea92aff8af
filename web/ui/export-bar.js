// Taking the picture away: as a PNG, as an EXR, or as the command that makes it.

import { el } from "./dom.js";

const COPIED_MS = 2000;

/** Hands a Blob to the browser's downloads. */
export function save(blob, name) {
  const url = URL.createObjectURL(blob);
  el("a", { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 10_000);
}

export class ExportBar {
  /** `element` holds the buttons `.png`, `.exr`, `.compare`, `.curl`, and the `dialog` with the command; `take`: a function by each name. */
  constructor(element, take) {
    this.buttons = ["png", "exr", "compare"].map((name) => {
      const button = element.querySelector(`.${name}`);
      button.addEventListener("click", take[name]);
      return button;
    });
    this.compareButton = this.buttons.at(-1);
    this.curlButton = element.querySelector(".curl");
    this.dialog = element.querySelector("dialog");
    this.text = this.dialog.querySelector("textarea");
    this.copyButton = this.dialog.querySelector(".copy");
    this.curlButton.addEventListener("click", () => this.#open(take.curl()));
    this.copyButton.addEventListener("click", () => this.#copy());
    this.dialog.querySelector(".close").addEventListener("click", () => this.dialog.close());
  }

  /** Whether there is a finished picture, and whether it is traced, so that a preview is something else. */
  offer(ready, isTraced) {
    for (const button of this.buttons) button.disabled = !ready;
    this.compareButton.disabled = !(ready && isTraced);
  }

  /** Whether there is a scene to name. */
  set nameable(nameable) {
    this.curlButton.disabled = !nameable;
  }

  #open(command) {
    this.text.value = command;
    this.text.rows = Math.min(command.length / 60 + 3, 16);
    this.dialog.showModal();
    this.#copy();
  }

  /** The clipboard may be refused (a page without TLS): then the text is selected for the person's own copy. */
  async #copy() {
    const copied = await navigator.clipboard?.writeText(this.text.value).then(
      () => true,
      () => false,
    );
    if (!copied) this.text.select();
    this.copyButton.textContent = copied ? "Copied" : "Press Ctrl+C";
    setTimeout(() => {
      this.copyButton.textContent = "Copy";
    }, COPIED_MS);
  }
}
