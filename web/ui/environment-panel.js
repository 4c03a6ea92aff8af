// Light from infinity: automatic, none, one colour, a gradient, or an HDRI.

import { CheckField, ColorField, SelectField, SliderField } from "./fields.js";
import { el, newId } from "./dom.js";

const KINDS = [
  ["auto", "Automatic"],
  ["none", "None"],
  ["constant", "One colour"],
  ["gradient", "Gradient"],
  ["hdri", "HDRI file"],
];

const NEUTRAL = {
  kind: "auto",
  constant: [1, 1, 1],
  gradient: { top: [0.5, 0.7, 1], horizon: [1, 1, 1], bottom: [0.2, 0.2, 0.2] },
  hdri: null,
  intensity: 1,
  rotation_degrees: 0,
  visible: true,
};

export class EnvironmentPanel {
  /** `onChange(live)`; `onFile(file)` uploads an HDRI and then sets `hdri`. */
  constructor(element, onChange, onFile) {
    this.onChange = onChange;
    this.onFile = onFile;
    this.body = el("div", { class: "fields" });
    element.append(this.body);
    this.open();
  }

  /** Begins anew, with some fields other than neutral. */
  open(changes = {}) {
    this.environment = { ...NEUTRAL, ...changes };
    this.#build();
  }

  /** Shows an uploaded HDRI: `{id, name, file}`. */
  set hdri(hdri) {
    this.#change({ kind: "hdri", hdri }, false);
    this.#build();
  }

  #change(changes, live) {
    this.environment = { ...this.environment, ...changes };
    this.onChange(live);
  }

  #build() {
    const { environment } = this;
    const kind = new SelectField("Kind", { value: environment.kind, options: KINDS }, (value) => {
      this.#change({ kind: value }, false);
      this.#build();
      this.body.querySelector("select").focus();
    });
    const given = !["auto", "none"].includes(environment.kind);
    const fields = [kind.element, ...this.#source(), ...(given ? this.#common() : [])];
    if (environment.kind === "auto")
      fields.push(el("p", { class: "hint" }, "A neutral sky, if nothing else in the scene shines."));
    this.body.replaceChildren(...fields);
  }

  #source() {
    const { kind, constant, gradient } = this.environment;
    if (kind === "constant") {
      return [
        new ColorField("Colour", { value: constant }, (value, live) => this.#change({ constant: value }, live)).element,
      ];
    }
    if (kind === "gradient") {
      return Object.entries({ top: "Top", horizon: "Horizon", bottom: "Bottom" }).map(
        ([name, label]) =>
          new ColorField(label, { value: gradient[name] }, (value, live) =>
            this.#change({ gradient: { ...this.environment.gradient, [name]: value } }, live),
          ).element,
      );
    }
    return kind === "hdri" ? [this.#chooser()] : [];
  }

  #chooser() {
    const id = newId();
    const input = el("input", { type: "file", id, accept: ".hdr,.exr", class: "visually-hidden" });
    input.addEventListener("change", () => {
      const [file] = input.files;
      input.value = "";
      if (file) this.onFile(file);
    });
    const name = this.environment.hdri?.name ?? "no file yet";
    const choose = el("label", { for: id, class: "button" }, "Choose .hdr or .exr");
    return el("div", { class: "row file" }, input, choose, el("span", { class: "file-name" }, name));
  }

  #common() {
    const { intensity, rotation_degrees: rotation, visible, kind } = this.environment;
    const fields = [
      new SliderField("Intensity", { value: intensity, min: 1 / 64, max: 64, log: true, lowest: 0 }, (value, live) =>
        this.#change({ intensity: value }, live),
      ),
      new CheckField("Seen by the camera", { value: visible }, (value) => this.#change({ visible: value }, false)),
    ];
    if (kind === "hdri") {
      fields.splice(
        1,
        0,
        new SliderField("Rotation", { value: rotation, min: -180, max: 180, unit: "°" }, (value, live) =>
          this.#change({ rotation_degrees: value }, live),
        ),
      );
    }
    return fields.map(({ element }) => element);
  }
}
