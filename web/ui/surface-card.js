// One sphere, or one material of the file with other values.

import { CheckField, ColorField, NumberField, SelectField, SliderField, VectorField } from "./fields.js";
import { el, newId } from "./dom.js";

const DETAILS = [
  ["none", "None"],
  ["height", "Height map"],
  ["normal", "Normal map"],
  ["parallax", "Parallax map"],
];
const METHODS = [
  ["relief", "Relief"],
  ["steep", "Steep"],
  ["offset", "Offset"],
  ["offset_limited", "Offset, limited"],
];

/** Sliders reach this factor above and below what is usual for the scene. */
const REACH = 32;

/** Less is nothing that a picture shows. */
const SMALLEST = 1e-6;

class SurfaceCard {
  constructor(surface, { title, number, onChange, onFile, onRemove }) {
    this.surface = surface;
    this.onChange = onChange;
    this.onFile = onFile;
    this.body = el("div", { class: "fields" });
    const name = `${title} ${number}`;
    const on = new CheckField(name, { value: surface.on }, (value) => this.change({ on: value }, false));
    const label = `Remove ${name.toLowerCase()}`;
    const remove = el(
      "button",
      { type: "button", class: "quiet", "aria-label": label, title: "Remove", onclick: onRemove },
      "✕",
    );
    this.element = el("li", { class: "card" }, el("div", { class: "card-head" }, on.element, remove), this.body);
  }

  change(changes, live) {
    Object.assign(this.surface, changes);
    this.onChange(live);
  }

  set(name) {
    return (value, live) => this.change({ [name]: value }, live);
  }

  part(label, name) {
    return new SliderField(label, { value: this.surface[name], min: 0, max: 1, highest: 1 }, this.set(name));
  }

  /** An optional value between 0 and `max`. */
  optional(label, name, placeholder, max = 1) {
    return new NumberField(label, { value: this.surface[name], min: 0, max, placeholder }, this.set(name));
  }

  build() {
    const { surface } = this;
    const detail = new SelectField("Detail", { value: surface.detail, options: DETAILS }, (value) => {
      const isOther = (value === "normal") !== (surface.detail === "normal");
      this.change({ detail: value, ...(isOther && { scale: this.#usualScale(value) }) }, false);
      this.build();
      this.body.querySelector("[data-field=detail] select").focus();
    });
    detail.element.dataset.field = "detail";
    const fields = [...this.values(), this.#file("Texture", "texture"), detail.element];
    if (surface.detail !== "none") fields.push(...this.#relief());
    if (surface.texture || (surface.detail !== "none" && surface.relief)) {
      const tiling = { value: surface.tiling, axes: ["u", "v"] };
      fields.push(new VectorField("Tiling", tiling, this.set("tiling")).element);
    }
    this.body.replaceChildren(...fields);
  }

  /** Of a normal map it is a factor, of others a length. */
  #usualScale(detail) {
    return detail === "normal" ? 1 : this.surface.usual.relief;
  }

  #relief() {
    const { surface } = this;
    const middle = this.#usualScale(surface.detail);
    const label = { height: "Height", normal: "Strength", parallax: "Depth" }[surface.detail];
    const scale = { value: surface.scale, min: middle / REACH, max: middle * REACH, log: true, lowest: 0 };
    const fields = [this.#file("Map", "relief"), new SliderField(label, scale, this.set("scale")).element];
    if (surface.detail === "parallax") {
      const method = { value: surface.method, options: METHODS };
      fields.push(new SelectField("Method", method, this.set("method")).element);
      const shadow = (value) => this.change({ self_shadow: value }, false);
      fields.push(new CheckField("Shadow on itself", { value: surface.self_shadow }, shadow).element);
    }
    return fields;
  }

  /** A picture of this computer's; it is uploaded when chosen. */
  #file(label, name) {
    const id = newId();
    const input = el("input", { type: "file", id, accept: ".png,.jpg,.jpeg,.webp", class: "visually-hidden" });
    input.addEventListener("change", async () => {
      const [file] = input.files;
      const image = file && (await this.onFile(file));
      if (!image) return;
      this.change({ [name]: image }, false);
      this.build();
    });
    const held = this.surface[name];
    const drop = el(
      "button",
      {
        type: "button",
        class: "quiet",
        "aria-label": `Without ${label.toLowerCase()}`,
        onclick: () => {
          this.change({ [name]: null }, false);
          this.build();
        },
      },
      "✕",
    );
    const choose = el("label", { for: id, class: "button" }, `${label} …`);
    const shown = el("span", { class: "file-name" }, held?.name ?? "none");
    return el("div", { class: "row file" }, input, choose, shown, held ? drop : null);
  }
}

export class SphereCard extends SurfaceCard {
  constructor(sphere, options) {
    super(sphere, { title: "Sphere", ...options });
    this.build();
  }

  values() {
    const { surface } = this;
    const { radius: usual } = surface.usual;
    const radius = { value: surface.radius, min: usual / REACH, max: usual * REACH, log: true, lowest: SMALLEST };
    return [
      new VectorField("Centre", { value: surface.center }, this.set("center")),
      new SliderField("Radius", radius, this.set("radius")),
      new ColorField("Colour", { value: surface.color }, this.set("color")),
      this.part("Metallic", "metallic"),
      this.part("Roughness", "roughness"),
      this.optional("Shininess", "shininess", "none", 1e6),
      this.optional("Reflectivity", "reflectivity", "0.04", 0.999),
    ].map(({ element }) => element);
  }
}

export class OverrideCard extends SurfaceCard {
  /** `names`: those to choose from; `onRename()` is called after another was chosen. */
  constructor(override, { names, onRename, ...options }) {
    super(override, { title: "Material", ...options });
    this.names = names;
    this.onRename = onRename;
    this.build();
  }

  values() {
    const { surface } = this;
    const names = this.names.map((name) => [name, name]);
    const own = new CheckField("Another colour", { value: surface.color !== null }, (value) => {
      this.change({ color: value ? [0.8, 0.8, 0.8] : null }, false);
      this.build();
    });
    return [
      new SelectField("Material", { value: surface.material, options: names }, (material) => {
        this.change({ material }, false);
        this.onRename();
      }),
      own,
      ...(surface.color ? [new ColorField("Colour", { value: surface.color }, this.set("color"))] : []),
      this.optional("Metallic", "metallic", "file’s"),
      this.optional("Roughness", "roughness", "file’s"),
    ].map(({ element }) => element);
  }
}
