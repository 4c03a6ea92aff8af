// One light: its kind, and the fields that this kind has.

import {
  CheckField,
  ColorField,
  DirectionField,
  NumberField,
  SelectField,
  SliderField,
  VectorField,
} from "./fields.js";
import { el } from "./dom.js";
import { subtract, tidy, tidyAll } from "../math/vector.js";
import { lightFields } from "../params.js";

const KINDS = [
  ["point", "Point"],
  ["spot", "Spot"],
  ["directional", "Directional"],
  ["rect", "Rectangle"],
  ["disk", "Disk"],
  ["sphere", "Ball"],
  ["ambient", "Ambient"],
];
const UNITS = { point: "cd", spot: "cd", directional: "lx", rect: "cd/m²", disk: "cd/m²", sphere: "cd/m²", ambient: "cd/m²" };
const FALLOFFS = [
  ["gltf", "glTF (squared)"],
  ["linear", "Linear in angle"],
];

/** Kinds that shine from a place to a side. */
const AIMED = ["spot", "rect", "disk"];

/** Degrees below which a sun is a point. */
const SMALLEST_SUN = 0.01;

/** Degrees between the cones, at the least. */
const CONE_GAP = 0.1;
const WIDEST_CONE = 90;

/** Sliders reach this factor above and below a kind's usual intensity. */
const REACH = 64;

export class LightCard {
  /**
   * `light` has the fields of all kinds, so that a change of kind loses nothing. `usual(kind)`: an
   * intensity that suits the scene; `center`: its middle.
   */
  constructor(light, { number, usual, center, onChange, onRemove }) {
    this.light = light;
    this.usual = usual;
    this.center = center;
    this.onChange = onChange;
    this.body = el("div", { class: "fields" });
    const on = new CheckField(`Light ${number}`, { value: light.on }, (value) => this.#change({ on: value }, false));
    const remove = el(
      "button",
      { type: "button", class: "quiet", "aria-label": `Remove light ${number}`, title: "Remove", onclick: onRemove },
      "✕",
    );
    this.element = el("li", { class: "card" }, el("div", { class: "card-head" }, on.element, remove), this.body);
    this.#build();
  }

  #change(changes, live) {
    Object.assign(this.light, changes);
    this.onChange(live);
  }

  #changeKind(type) {
    this.#change({ type, intensity: this.usual(type) }, false);
    this.#build();
    this.body.querySelector("select").focus();
  }

  #build() {
    const { light } = this;
    const set = (name) => (value, live) => this.#change({ [name]: value }, live);
    const middle = this.usual(light.type);
    const makers = {
      position: () => new VectorField("Position", { value: light.position }, set("position")),
      direction: () => new DirectionField({ value: light.direction }, set("direction")),
      color: () => new ColorField("Colour", { value: light.color }, set("color")),
      intensity: () =>
        new SliderField(
          "Intensity",
          {
            value: light.intensity,
            min: middle / REACH,
            max: middle * REACH,
            log: true,
            lowest: 0,
            unit: UNITS[light.type],
          },
          set("intensity"),
        ),
      range: () => new NumberField("Range", { value: light.range, min: 1e-6, placeholder: "infinite" }, set("range")),
      inner_cone_degrees: () => this.#cone("Inner cone", "inner_cone_degrees", [0, WIDEST_CONE - CONE_GAP]),
      outer_cone_degrees: () => this.#cone("Outer cone", "outer_cone_degrees", [CONE_GAP, WIDEST_CONE]),
      angular_diameter_degrees: () =>
        new SliderField(
          "Diameter",
          { value: light.angular_diameter_degrees, min: 0, max: 30, lowest: 0, highest: 180, unit: "°" },
          (value, live) => set("angular_diameter_degrees")(value < SMALLEST_SUN ? 0 : value, live),
        ),
      up: () => new VectorField("Up", { value: light.up }, set("up")),
      width: () => new NumberField("Width", { value: light.width, min: 1e-6 }, set("width")),
      height: () => new NumberField("Height", { value: light.height, min: 1e-6 }, set("height")),
      radius: () => new NumberField("Radius", { value: light.radius, min: 1e-6 }, set("radius")),
      visible: () => new CheckField("In the picture", { value: light.visible }, set("visible")),
      falloff: () => new SelectField("Edge", { value: light.falloff, options: FALLOFFS }, set("falloff")),
    };
    const kind = new SelectField("Kind", { value: light.type, options: KINDS }, (type) => this.#changeKind(type));
    this.fields = Object.fromEntries(lightFields(light.type).map((name) => [name, makers[name]()]));
    const aim = el("button", { type: "button", onclick: () => this.#aim() }, "Aim at the middle");
    const rows = Object.values(this.fields).map(({ element }) => element);
    this.body.replaceChildren(kind.element, ...rows, ...(AIMED.includes(light.type) ? [aim] : []));
  }

  #aim() {
    const direction = tidyAll(subtract(this.center, this.light.position), 4);
    if (direction.every((x) => x === 0)) return;
    this.fields.direction.value = direction;
    this.#change({ direction }, false);
  }

  /** The inner cone stays within the outer one. */
  #cone(label, name, [min, max]) {
    const range = { value: this.light[name], min, max, highest: max, unit: "°" };
    return new SliderField(label, range, (value, live) => {
      const [other, limit] =
        name === "inner_cone_degrees"
          ? ["outer_cone_degrees", Math.max(this.light.outer_cone_degrees, tidy(value + CONE_GAP))]
          : ["inner_cone_degrees", Math.min(this.light.inner_cone_degrees, tidy(value - CONE_GAP))];
      if (this.light[other] !== limit) this.fields[other].value = limit;
      this.#change({ [name]: value, [other]: limit }, live);
    });
  }
}
