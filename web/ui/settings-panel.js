// The single values of a request: look (exposure, curve), quality (when to stop), size and background.

import { CheckField, Hint, NumberField, SelectField, SliderField } from "./fields.js";

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
  ["polynomial", "Polynomial"],
  ["range", "1 − d / range"],
];
const SPOT_EDGES = [
  ["light", "As the light says"],
  ["linear_cosine", "Linear in the cosine"],
];
const BRDFS = [
  ["pbr", "Physically based"],
  ["phong", "Phong"],
];
const PATHS = [
  ["deferred", "Deferred"],
  ["forward", "Forward"],
];
const WHOLE = { step: 1 };

const BIAS = { min: 0, max: 1000, unit: "texels" };
const RADIUS = { min: 0, max: 256, placeholder: "auto", unit: "texels" };

const isDirect = (settings) => settings.mode === "direct";
const isPhong = (settings) => isDirect(settings) && settings["direct.shading"] === "phong";
const isPolynomial = (settings) => settings["preview.attenuation.kind"] === "polynomial";
const isByRange = (settings) => settings["preview.attenuation.kind"] === "range";
const isFiltered = (settings) => ["pcf", "noise"].includes(settings["preview.shadows.algorithm"]);
const hasGizmos = (settings) => settings["preview.gizmos"];

const TOO_BRIGHT =
  "A light’s intensity is then what it gives at no distance at all: lights that are meant for 1 / d² are far too bright. Turn them down.";

/**
 * Per panel: setting, field class, label, options. `to` and `from` change units between field and setting; `when`: shown
 * only while this holds of the panel's settings; `hidden`: shown only once the server is known to be able to.
 */
const PANELS = {
  look: [
    ["exposure", SliderField, "Exposure", { min: -6, max: 6, lowest: -32, highest: 32, unit: "stops" }],
    ["tone_mapping", SelectField, "Tone curve", { options: CURVES }],
  ],
  quality: [
    ["mode", SelectField, "Light paths", { options: MODES }],
    ["direct.shading", SelectField, "Shading", { options: BRDFS, when: isDirect }],
    ["direct.specular", NumberField, "Highlight", { min: 0, when: isPhong }],
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
    ["preview.attenuation.constant", NumberField, "Constant", { min: 0, when: isPolynomial }],
    ["preview.attenuation.linear", NumberField, "Linear", { min: 0, when: isPolynomial }],
    ["preview.attenuation.quadratic", NumberField, "Quadratic", { min: 0, when: isPolynomial }],
    ["preview.attenuation.hint", Hint, TOO_BRIGHT, { when: isByRange }],
    ["preview.spot_edge", SelectField, "Edge of spots", { options: SPOT_EDGES }],
    ["preview.shadows.algorithm", SelectField, "Shadows", { options: SHADOWS }],
    ["preview.shadows.max_lights", NumberField, "Lights with shadows", { min: 0, max: 16, ...WHOLE }],
    ["preview.shadows.taps", NumberField, "Taps", { min: 1, max: 1024, ...WHOLE }],
    ["preview.shadows.radius", NumberField, "Filter radius", { ...RADIUS, when: isFiltered }],
    ["preview.shadows.map_size", NumberField, "Map size", { min: 16, max: 8192, ...WHOLE, unit: "texels" }],
    ["preview.shadows.light_size", NumberField, "Size of lights", { min: 0 }],
    ["preview.shadows.bias.constant", NumberField, "Bias", BIAS],
    ["preview.shadows.bias.slope", NumberField, "Bias by slope", BIAS],
    ["preview.shadows.bias.normal", NumberField, "Bias by normal", BIAS],
    ["preview.path", SelectField, "Order", { options: PATHS }],
    ["preview.gizmos", CheckField, "Show lights", {}],
    ["preview.gizmo_size", NumberField, "Their size", { min: 1e-4, max: 1, unit: "radii", when: hasGizmos }],
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
    this.settings = { ...settings };
    this.sometimes = [];
    for (const [name, Kind, label, { to, from, when, hidden = false, ...options }] of PANELS[panel]) {
      const value = convert(settings[name], to);
      const field = new Kind(label, { value, ...options }, (input, live) => {
        this.settings[name] = convert(input, from);
        this.#reveal();
        onChange({ [name]: this.settings[name] }, live);
      });
      field.element.dataset.setting = name;
      field.element.hidden = hidden;
      if (when) this.sometimes.push([field.element, when]);
      element.append(field.element);
    }
    this.element = element;
    this.#reveal();
  }

  /** Shows a setting that not every server has. */
  offer(setting) {
    this.element.querySelector(`[data-setting="${setting}"]`).hidden = false;
  }

  #reveal() {
    for (const [element, when] of this.sometimes) element.hidden = !when(this.settings);
  }
}
