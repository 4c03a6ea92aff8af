// The single values of a request: look (exposure, curve), quality (when to stop), size and background.

import { CheckField, NumberField, SelectField, SliderField } from "./fields.js";

const CURVES = [
  ["aces", "ACES"],
  ["agx", "AgX"],
  ["pbr_neutral", "PBR Neutral"],
  ["reinhard", "Reinhard"],
  ["linear", "Linear (clipped)"],
];
const MODES = [
  ["path", "Path (all light)"],
  ["direct", "Direct (hard shadows)"],
];
const WHOLE = { step: 1 };

/** Per panel: setting, field class, label, options. `to` and `from` change units between field and setting. */
const PANELS = {
  look: [
    ["exposure", SliderField, "Exposure", { min: -6, max: 6, lowest: -32, highest: 32, unit: "stops" }],
    ["tone_mapping", SelectField, "Tone curve", { options: CURVES }],
  ],
  quality: [
    ["mode", SelectField, "Light paths", { options: MODES }],
    ["max_bounces", NumberField, "Bounces", { min: 0, ...WHOLE, placeholder: "unlimited" }],
    ["max_samples", NumberField, "Samples per pixel", { min: 1, ...WHOLE }],
    ["adaptive", CheckField, "Adaptive sampling", {}],
    [
      "target_error",
      NumberField,
      "Stop at error",
      { min: 0.01, placeholder: "none", unit: "%", to: (x) => x * 100, from: (x) => x / 100 },
    ],
    [
      "deadline_ms",
      NumberField,
      "Stop after",
      { min: 0.001, placeholder: "none", unit: "s", to: (x) => x / 1000, from: (x) => Math.round(x * 1000) },
    ],
    ["seed", NumberField, "Seed", { min: 0, max: 4294967295, ...WHOLE }],
    ["multiple_scattering", CheckField, "Energy compensation", {}],
  ],
  picture: [
    ["width", NumberField, "Width", { min: 1, ...WHOLE, unit: "px" }],
    ["height", NumberField, "Height", { min: 1, ...WHOLE, unit: "px" }],
    ["transparent", CheckField, "Transparent background", {}],
  ],
};

const convert = (value, by) => (value === null || !by ? value : by(value));

export class SettingsPanel {
  /** `panel`: key of PANELS; `onChange({setting: value}, live)`. */
  constructor(element, panel, settings, onChange) {
    for (const [name, Kind, label, { to, from, ...options }] of PANELS[panel]) {
      const value = convert(settings[name], to);
      const field = new Kind(label, { value, ...options }, (input, live) =>
        onChange({ [name]: convert(input, from) }, live),
      );
      field.element.dataset.setting = name;
      element.append(field.element);
    }
  }
}
