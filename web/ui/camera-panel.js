// Where to look from: a camera of the file, or a free orbit; and the lens.

import { SelectField, SliderField, NumberField } from "./fields.js";
import { el } from "./dom.js";
import { Orbit, boundingSphere } from "../math/orbit.js";

const FREE = "free";

/** Largest aperture of the slider, as a part of the scene's radius. */
const WIDEST = 0.1;

const OPENINGS = [
  ["0", "Round"],
  ...[5, 6, 7, 8, 9].map((blades) => [String(blades), `${blades} blades`]),
];

const HELP =
  "Drag turns, Shift or the right button pans, the wheel zooms. Touch: one finger turns, two pan and pinch. " +
  "Keys: arrows, Shift + arrows, + and −; 0 shows all.";

export class CameraPanel {
  /** Where a framed orbit turned out to stand: what a hand goes on from. */
  #found = null;

  /**
   * What is shown: camera `index` of the file, or the free `orbit` if that is null; the orbit is then where a hand goes
   * on from.
   */
  camera = { index: null, orbit: null, aperture_radius: 0, blades: 0, focus_distance: null };

  /** `onChange(live)`; `onFrame()` asks for the whole scene in the picture. */
  constructor(element, onChange, onFrame) {
    this.onChange = onChange;
    this.fields = el("div", { class: "fields" });
    const frame = el("button", { type: "button", onclick: onFrame }, "Show all");
    element.append(this.fields, el("div", { class: "row" }, frame), el("p", { class: "hint" }, HELP));
  }

  /** Begins with a scene's first camera, or with `framing` if it has none. */
  open(scene, framing) {
    this.scene = scene;
    this.camera = { index: null, orbit: framing, aperture_radius: 0, blades: 0, focus_distance: null };
    this.#found = null;
    const named = scene.cameras.map(({ name }, i) => [String(i), name ?? `Camera ${i + 1}`]);
    const options = [...named, [FREE, "Free orbit"]];
    this.view = new SelectField("View", { value: FREE, options }, (value) =>
      this.#change(value === FREE ? { index: null } : this.#placed(Number(value)), false),
    );
    const angle = { value: framing.yfov, min: 5, max: 120, lowest: 1, highest: 170, unit: "°" };
    this.fov = new SliderField("Field of view", angle, (yfov, live) =>
      this.#change({ index: null, orbit: this.orbit.with({ yfov }) }, live),
    );
    const widest = boundingSphere(scene.bounds).radius * WIDEST;
    const aperture = new SliderField("Aperture", { value: 0, min: 0, max: widest }, (radius, live) =>
      this.#change({ aperture_radius: radius }, live),
    );
    const shape = new SelectField("Opening", { value: "0", options: OPENINGS }, (blades) =>
      this.#change({ blades: Number(blades) }, false),
    );
    const focus = new NumberField("Focus at", { value: null, min: 1e-6, placeholder: "target" }, (distance, live) =>
      this.#change({ focus_distance: distance }, live),
    );
    this.fields.replaceChildren(...[this.view, this.fov, aperture, shape, focus].map(({ element }) => element));
    if (scene.cameras.length > 0) Object.assign(this.camera, this.#placed(0));
    this.#reflect();
  }

  get orbit() {
    return this.#found ? this.camera.orbit.with(this.#found) : this.camera.orbit;
  }

  /** Takes an orbit that came from elsewhere (a hand on the picture). */
  set orbit(orbit) {
    this.#found = null;
    this.camera = { ...this.camera, index: null, orbit };
    this.#reflect();
  }

  /** Hears, in the `defaults` of a picture's report, where the server has put an orbit that it was to frame. */
  hear(defaults) {
    const value = (what) => defaults.find((taken) => taken.what === what)?.value;
    const [target, distance] = [value("camera.target"), value("camera.orbit.distance")];
    if (this.camera.orbit.framed && target && distance) this.#found = { target, distance };
  }

  /** From now on the camera stays where it is, whatever else changes. */
  settle() {
    this.camera = { ...this.camera, orbit: this.orbit };
    this.#found = null;
  }

  #placed(index) {
    return { index, orbit: Orbit.fromCamera(this.scene.cameras[index], this.scene.bounds) };
  }

  #change(changes, live) {
    if (changes.orbit) this.#found = null;
    this.camera = { ...this.camera, ...changes };
    this.#reflect();
    this.onChange(live);
  }

  #reflect() {
    this.view.value = this.camera.index === null ? FREE : String(this.camera.index);
    if (document.activeElement !== this.fov.number) this.fov.value = this.orbit.yfov;
  }
}
