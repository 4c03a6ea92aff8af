// The picture, and the hands on it: mouse, touch and keyboard all become turn, pan and zoom.

import { el } from "./dom.js";

const KEY_STEP = 0.04;
const KEY_ZOOM = 1.1;
const WHEEL_ZOOM = 0.0015;
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

export class Viewport {
  #pointers = new Map();
  #url = null;
  #picture = 0;

  /** `hand`: `turn(dx, dy)`, `pan(dx, dy)` in picture heights, `zoom(factor)`, `frame()`. */
  constructor(element, hand) {
    this.element = element;
    this.hand = hand;
    this.image = el("img", { alt: "", draggable: "false", hidden: true });
    element.append(this.image);
    element.addEventListener("pointerdown", (event) => this.#down(event));
    element.addEventListener("pointermove", (event) => this.#move(event));
    for (const name of ["pointerup", "pointercancel"]) {
      element.addEventListener(name, (event) => this.#pointers.delete(event.pointerId));
    }
    element.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
    element.addEventListener("keydown", (event) => this.#key(event));
    element.addEventListener("dblclick", () => hand.frame());
    element.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  /** Shows a picture once it is decoded, so that nothing flickers. */
  async show(blob, description) {
    this.#picture += 1;
    const mine = this.#picture;
    const url = URL.createObjectURL(blob);
    const next = new Image();
    next.src = url;
    const decoded = await next.decode().then(
      () => true,
      () => false,
    );
    if (!decoded || mine !== this.#picture) {
      URL.revokeObjectURL(url);
      return;
    }
    this.image.src = url;
    this.image.alt = description;
    this.image.hidden = false;
    if (this.#url) URL.revokeObjectURL(this.#url);
    this.#url = url;
  }

  /** Width / height of the pictures, for the space that they take before they come. */
  set aspect(aspect) {
    this.element.style.setProperty("--aspect", aspect);
  }

  /** Lets what is behind a transparent picture be seen as a chequered ground. */
  set transparent(on) {
    this.image.classList.toggle("chequered", on);
  }

  #height() {
    return this.image.clientHeight || this.element.clientHeight;
  }

  #down(event) {
    this.element.focus({ preventScroll: true });
    this.element.setPointerCapture(event.pointerId);
    this.#pointers.set(event.pointerId, [event.clientX, event.clientY]);
  }

  #move(event) {
    const before = this.#pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    const [dx, dy] = now.map((x, i) => (x - before[i]) / this.#height());
    const other = [...this.#pointers].find(([id]) => id !== event.pointerId)?.[1];
    this.#pointers.set(event.pointerId, now);
    if (dx === 0 && dy === 0) return;
    if (other) this.#pinch(before, now, other, dx, dy);
    else if (event.shiftKey || event.buttons & 6) this.hand.pan(dx, dy);
    else this.hand.turn(dx, dy);
  }

  /** One of two fingers moved: half of it moves the middle, and the span between them zooms. */
  #pinch(before, now, other, dx, dy) {
    const span = ([x, y]) => Math.max(Math.hypot(x - other[0], y - other[1]), 1);
    this.hand.pan(dx / 2, dy / 2);
    this.hand.zoom(span(now) / span(before));
  }

  #wheel(event) {
    event.preventDefault();
    const pixels = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? event.deltaY * 30 : event.deltaY;
    this.hand.zoom(Math.exp(-pixels * WHEEL_ZOOM));
  }

  #key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const arrow = ARROWS[event.key];
    if (arrow) {
      const [dx, dy] = arrow.map((x) => x * KEY_STEP);
      if (event.shiftKey) this.hand.pan(dx, dy);
      else this.hand.turn(dx, dy);
    } else if (event.key === "+" || event.key === "=") this.hand.zoom(KEY_ZOOM);
    else if (event.key === "-" || event.key === "_") this.hand.zoom(1 / KEY_ZOOM);
    else if (event.key === "0" || event.key === "Home") this.hand.frame();
    else return;
    event.preventDefault();
  }
}
