// Labelled inputs. Each has `element` to place and `value` to read and set, and calls `onInput(value, live)`:
// `live` is true while the hand is still at it, false when the value is settled.

import { el, newId } from "./dom.js";
import { hexToLinear, linearToHex } from "../math/color.js";
import { fromAngles, toAngles } from "../math/sphere.js";
import { tidy, tidyAll } from "../math/vector.js";

/** A row: label, then what there is to touch. */
function row(label, id, ...controls) {
  return el("div", { class: "field" }, el("label", { for: id }, label), el("div", { class: "controls" }, ...controls));
}

/** A row of several inputs under one name. */
function group(label, ...controls) {
  const id = newId();
  const name = el("span", { id, class: "label" }, label);
  return el(
    "div",
    { class: "field", role: "group", "aria-labelledby": id },
    name,
    el("div", { class: "controls" }, ...controls),
  );
}

/** An input that passes on valid numbers alone: of others it says what is wrong, and the number before counts. */
function numberInput({ step = "any", ...attributes }, onInput) {
  const input = el("input", { type: "number", step, inputmode: "decimal", ...attributes });
  const tell = (live) => {
    if (judge(input)) onInput(live);
  };
  input.addEventListener("input", () => tell(true));
  input.addEventListener("change", () => tell(false));
  return input;
}

/** Whether an input holds what it should; if not, its field says why, in the words of the browser. */
function judge(input) {
  const valid = input.validity.valid;
  input.setAttribute("aria-invalid", !valid);
  const words = document.getElementById(input.getAttribute("aria-describedby"));
  if (valid) {
    words?.remove();
    input.removeAttribute("aria-describedby");
  } else if (words) {
    words.textContent = input.validationMessage;
  } else {
    const id = newId();
    input.closest(".field").append(el("p", { id, class: "fault" }, input.validationMessage));
    input.setAttribute("aria-describedby", id);
  }
  return valid;
}

function setNumber(input, number) {
  input.value = number;
  judge(input);
}

/** A number; with `placeholder` it may be empty, and is then null. */
export class NumberField {
  constructor(label, { value, min, max, step, placeholder, unit }, onInput) {
    const id = newId();
    const range = { id, min, max, step, placeholder, required: placeholder === undefined };
    this.input = numberInput(range, (live) => onInput(this.value, live));
    this.element = row(label, id, this.input, unit ? el("span", { class: "unit" }, unit) : null);
    this.value = value;
  }

  get value() {
    return this.input.value === "" ? null : this.input.valueAsNumber;
  }

  set value(value) {
    setNumber(this.input, value === null ? "" : tidy(value));
  }
}

/** A slider with a number beside it, which may go beyond the slider's ends. `log`: equal steps are equal ratios. */
export class SliderField {
  /** What was valid last. */
  #value;

  constructor(label, { value, min, max, step = "any", log = false, lowest = min, highest, unit }, onInput) {
    const id = newId();
    this.toSlider = log ? Math.log2 : (x) => x;
    this.fromSlider = log ? (x) => 2 ** x : (x) => x;
    this.slider = el("input", {
      type: "range",
      min: this.toSlider(min),
      max: this.toSlider(max),
      step,
      "aria-label": `${label}, slider`,
    });
    this.number = numberInput({ id, min: lowest, max: highest, required: true }, (live) => {
      this.#value = this.number.valueAsNumber;
      this.#slide();
      onInput(this.value, live);
    });
    const slid = (live) => {
      this.#value = tidy(this.fromSlider(this.slider.valueAsNumber), 3);
      setNumber(this.number, this.#value);
      onInput(this.value, live);
    };
    this.slider.addEventListener("input", () => slid(true));
    this.slider.addEventListener("change", () => slid(false));
    this.element = row(label, id, this.slider, this.number, unit ? el("span", { class: "unit" }, unit) : null);
    this.value = value;
  }

  get value() {
    return this.#value;
  }

  set value(value) {
    this.#value = value;
    setNumber(this.number, tidy(value));
    this.#slide();
  }

  /** The logarithm of 0 lies beyond every slider: it stands at its end then. */
  #slide() {
    this.slider.value = Math.max(this.toSlider(this.#value), Number(this.slider.min));
  }
}

/** One of `[[value, text], ...]`; values are strings. */
export class SelectField {
  constructor(label, { value, options }, onInput) {
    const id = newId();
    this.select = el("select", { id, onchange: () => onInput(this.value, false) });
    this.options = options;
    this.element = row(label, id, this.select);
    this.value = value;
  }

  set options(options) {
    this.select.replaceChildren(...options.map(([value, text]) => el("option", { value }, text)));
  }

  get value() {
    return this.select.value;
  }

  set value(value) {
    this.select.value = value;
  }
}

/** Yes or no. */
export class CheckField {
  constructor(label, { value }, onInput) {
    this.input = el("input", { type: "checkbox", onchange: () => onInput(this.value, false) });
    this.element = el("label", { class: "check" }, this.input, el("span", {}, label));
    this.value = value;
  }

  get value() {
    return this.input.checked;
  }

  set value(value) {
    this.input.checked = value;
  }
}

/** A colour, picked in sRGB, held linear. */
export class ColorField {
  constructor(label, { value }, onInput) {
    const id = newId();
    this.input = el("input", { type: "color", id });
    this.input.addEventListener("input", () => onInput(this.value, true));
    this.input.addEventListener("change", () => onInput(this.value, false));
    this.element = row(label, id, this.input);
    this.value = value;
  }

  get value() {
    return hexToLinear(this.input.value);
  }

  set value(value) {
    this.input.value = linearToHex(value);
  }
}

/** A point: x, y, z; or what else has a number along some axes. */
export class VectorField {
  /** What was valid last. */
  #value;

  constructor(label, { value, axes = ["x", "y", "z"] }, onInput) {
    const tell = (i, live) => {
      this.#value = this.#value.with(i, this.inputs[i].valueAsNumber);
      onInput(this.#value, live);
    };
    this.inputs = axes.map((axis, i) => {
      const named = { "aria-label": `${label} ${axis}`, title: axis, required: true };
      return numberInput(named, (live) => tell(i, live));
    });
    this.element = group(label, ...this.inputs);
    this.value = value;
  }

  get value() {
    return this.#value;
  }

  set value(value) {
    this.#value = value;
    this.inputs.forEach((input, i) => setNumber(input, tidy(value[i], 4)));
  }
}

/** Words among the fields. */
export class Hint {
  constructor(text) {
    this.element = el("p", { class: "hint" }, text);
  }
}

/** A direction that light travels in, turned by two angles of where it comes from. */
export class DirectionField {
  constructor({ value }, onInput) {
    const tell = (_, live) => onInput(this.value, live);
    this.azimuth = new SliderField("From around", { value: 0, min: -180, max: 180, unit: "°" }, tell);
    this.elevation = new SliderField("From above", { value: 0, min: -90, max: 90, highest: 90, unit: "°" }, tell);
    this.element = el("div", { class: "fields" }, this.azimuth.element, this.elevation.element);
    this.value = value;
  }

  get value() {
    const source = fromAngles(this.azimuth.value, this.elevation.value);
    return tidyAll(
      source.map((x) => -x),
      4,
    ).map((x) => (Math.abs(x) < 1e-4 ? 0 : x));
  }

  set value(direction) {
    const { azimuth, elevation } = toAngles(direction.map((x) => -x));
    this.azimuth.value = tidy(azimuth, 3);
    this.elevation.value = tidy(elevation, 3);
  }
}
