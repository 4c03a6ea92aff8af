// Where to look from: a camera of the file, or a free orbit; and the lens.

import { SelectField, SliderField, NumberField } from "./fields.js";
import { el } from "./dom.js";
import { boundingSphere } from "../math/orbit.js";

const FREE = "free";
const WIDEST_LENS = 0.1;

export class CameraPanel {
  /** `onChange(camera, live)`; `onFrame()` asks for the whole scene in the picture. */
  constructor(element, onChange, onFrame) {
    this.onChange = onChange;
    this.fields = el("div", { class: "fields" });
    const frame = el("button", { type: "button", onclick: onFrame }, "Show all");
    element.append(this.fields, el("div", { class: "row" }, frame), el("p", { class: "hint" },
      "Drag turns, Shift or right button pans, wheel zooms. Touch: one finger turns, two pan and pinch. Keys: arrows, Shift + arrows, + and −, 0 shows all."));
  }

  /** Begins with a scene's first camera, or with `orbit` if it has none. */
  open(scene, orbit) {
    this.camera = { index: scene.cameras.length > 0 ? 0 : null, orbit, aperture_radius: 0, focus_distance: null };
    const named = scene.cameras.map(({ name }, i) => [String(i), name ?? `Camera ${i + 1}`]);
    const { radius } = boundingSphere(scene.bounds);
    this.view = new SelectField("View", { value: FREE, options: [...named, [FREE, "Free orbit"]] }, (value) =>
      this.#change({ index: value === FREE ? null : Number(value) }, false),
    );
    this.fov = new SliderField("Field of view", { value: orbit.yfov, min: 5, max: 120, lowest: 1, highest: 170, unit: "°" }, (yfov, live) =>
      this.#change({ index: null, orbit: this.camera.orbit.with({ yfov }) }, live),
    );
    const lens = new SliderField("Aperture", { value: 0, min: 0, max: radius * WIDEST_LENS }, (aperture_radius, live) =>
      this.#change({ aperture_radius }, live),
    );
    const focus = new NumberField("Focus at", { value: null, min: 1e-6, placeholder: "target" }, (focus_distance, live) =>
      this.#change({ focus_distance }, live),
    );
    this.fields.replaceChildren(this.view.element, this.fov.element, lens.element, focus.element);
    this.#reflect();
  }

  /** Takes an orbit that came from elsewhere (a hand on the picture). */
  set orbit(orbit) {
    this.camera = { ...this.camera, index: null, orbit };
    this.#reflect();
  }

  #change(changes, live) {
    this.camera = { ...this.camera, ...changes };
    this.#reflect();
    this.onChange(this.camera, live);
  }

  #reflect() {
    this.view.value = this.camera.index === null ? FREE : String(this.camera.index);
    if (document.activeElement !== this.fov.number) this.fov.value = this.camera.orbit.yfov;
  }
}
