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
  ["preview", "Preview (rasterised)"],
];
const MOVING = [
  ["preview", "Preview"],
  ["traced", "Few traced samples"],
];
const SHADINGS = [
  ["pbr", "Physically based"],
  ["lambert", "Lambert"],
  ["phong", "Phong"],
  ["blinn_phong", "Blinn-Phong"],
];
const SHADOWS = [
  ["none", "None"],
  ["basic", "One tap"],
  ["pcf", "PCF"],
  ["noise", "Noise"],
  ["pcss", "PCSS"],
  ["pcss_noise", "PCSS, noise"],
  ["ray", "Rays"],
];
const FALLOFFS = [
  ["physical", "Physical"],
  ["polynomial", "1 / (1 + 0.7 d + 1.8 d²)"],
  ["range", "1 − d / range"],
];
const SPOT_EDGES = [
  ["light", "As the light says"],
  ["linear_cosine", "Linear in the cosine"],
];
const PATHS = [
  ["deferred", "Deferred"],
  ["forward", "Forward"],
];
const WHOLE = { step: 1 };

const BIAS = { min: 0, max: 1000, unit: "texels" };

/**
 * Per panel: setting, field class, label, options. `to` and `from` change units between field and setting; `hidden`: shown only once the
 * server is known to be able to.
 */
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
    ["denoise", CheckField, "Denoise (smooths, may invent)", { hidden: true }],
  ],
  preview: [
    ["moving", SelectField, "While moving", { options: MOVING }],
    ["preview.shading", SelectField, "Shading", { options: SHADINGS }],
    ["preview.shininess", NumberField, "Shininess", { min: 1 }],
    ["preview.specular", NumberField, "Highlight", { min: 0 }],
    ["preview.attenuation.kind", SelectField, "Falloff", { options: FALLOFFS }],
    ["preview.spot_edge", SelectField, "Edge of spots", { options: SPOT_EDGES }],
    ["preview.shadows.algorithm", SelectField, "Shadows", { options: SHADOWS }],
    ["preview.shadows.max_lights", NumberField, "Lights with shadows", { min: 0, max: 16, ...WHOLE }],
    ["preview.shadows.taps", NumberField, "Taps", { min: 1, max: 1024, ...WHOLE }],
    ["preview.shadows.map_size", NumberField, "Map size", { min: 16, max: 8192, ...WHOLE, unit: "texels" }],
    ["preview.shadows.light_size", NumberField, "Size of lights", { min: 0 }],
    ["preview.shadows.bias.constant", NumberField, "Bias", BIAS],
    ["preview.shadows.bias.slope", NumberField, "Bias by slope", BIAS],
    ["preview.shadows.bias.normal", NumberField, "Bias by normal", BIAS],
    ["preview.path", SelectField, "Order", { options: PATHS }],
    ["preview.gizmos", CheckField, "Show lights", {}],
    ["preview.samples", NumberField, "Frames averaged", { min: 1, max: 256, ...WHOLE }],
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
    for (const [name, Kind, label, { to, from, hidden = false, ...options }] of PANELS[panel]) {
      const value = convert(settings[name], to);
      const field = new Kind(label, { value, ...options }, (input, live) =>
        onChange({ [name]: convert(input, from) }, live),
      );
      field.element.dataset.setting = name;
      field.element.hidden = hidden;
      element.append(field.element);
    }
    this.element = element;
  }

  /** Shows a setting that not every server has. */
  offer(setting) {
    this.element.querySelector(`[data-setting="${setting}"]`).hidden = false;
  }
}
