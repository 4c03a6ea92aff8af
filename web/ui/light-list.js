// The request's lights, with add and remove; and whether those of the file shine.

import { CheckField } from "./fields.js";
import { LightCard } from "./light-card.js";
import { el } from "./dom.js";
import { add, scale, tidy, tidyAll } from "../math/vector.js";
import { boundingSphere } from "../math/orbit.js";

/** Where a new light stands, seen from the scene's centre: above, to the right, in front. */
const ABOVE = [0.5, 0.8, 0.6];

/** Radius of a new light with an extent, as a part of the scene's. */
const SIZE = 0.25;

export class LightList {
  /** `onChange(sceneLights, live)`. */
  constructor(element, onChange) {
    this.lights = [];
    this.sceneLights = true;
    this.tell = (live) => onChange(this.sceneLights, live);
    this.ofFile = new CheckField("Lights of the file", { value: true }, (value) => {
      this.sceneLights = value;
      this.tell(false);
    });
    this.list = el("ul", { class: "cards", "aria-label": "Lights" });
    this.addButton = el("button", { type: "button", onclick: () => this.#add() }, "Add light");
    element.append(this.ofFile.element, this.list, el("div", { class: "row" }, this.addButton));
  }

  /** Begins anew with a scene. */
  open(scene) {
    this.lights = [];
    this.sceneLights = true;
    this.sphere = boundingSphere(scene.bounds);
    this.ofFile.value = true;
    this.ofFile.element.hidden = scene.lights.length === 0;
    this.ofFile.element.lastChild.textContent = `Lights of the file (${scene.lights.length})`;
    this.#draw();
  }

  /** About what lights a white surface at the scene's centre fully. */
  #usual(type) {
    const near = tidy(Math.PI * (this.sphere.radius * 2) ** 2, 3);
    // Radiance of what is a part of its distance wide.
    const wide = tidy((2 / SIZE) ** 2, 3);
    const ball = { disk: wide, sphere: wide, rect: tidy(Math.PI * (1 / SIZE) ** 2, 3) };
    return { point: near, spot: near, directional: 3.14, ambient: 0.5, ...ball }[type];
  }

  #add() {
    const offset = scale(ABOVE, (this.sphere.radius * 2) / Math.hypot(...ABOVE));
    this.lights.push({
      on: true,
      type: "point",
      position: tidyAll(add(this.sphere.center, offset), 3),
      direction: tidyAll(scale(ABOVE, -1), 3),
      color: [1, 1, 1],
      intensity: this.#usual("point"),
      range: null,
      inner_cone_degrees: 15,
      outer_cone_degrees: 30,
      falloff: "gltf",
      angular_diameter_degrees: 0,
      up: [0, 1, 0],
      width: tidy(2 * SIZE * this.sphere.radius, 3),
      height: tidy(2 * SIZE * this.sphere.radius, 3),
      radius: tidy(SIZE * this.sphere.radius, 3),
      visible: true,
    });
    this.#draw();
    this.list.lastElementChild.querySelector("select").focus();
    this.tell(false);
  }

  #remove(light) {
    this.lights = this.lights.filter((other) => other !== light);
    this.#draw();
    this.addButton.focus();
    this.tell(false);
  }

  #draw() {
    const cards = this.lights.map(
      (light, i) =>
        new LightCard(light, {
          number: i + 1,
          usual: (type) => this.#usual(type),
          center: this.sphere.center,
          onChange: this.tell,
          onRemove: () => this.#remove(light),
        }),
    );
    this.list.replaceChildren(...cards.map(({ element }) => element));
    this.list.hidden = cards.length === 0;
  }
}
