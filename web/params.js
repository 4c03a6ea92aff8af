// From what the widgets hold to the parameters of a request: only what differs from the API's defaults.

/** Defaults of the API, as far as the page can change them. */
export const DEFAULTS = {
  mode: "path",
  width: 1200,
  height: 500,
  scene_lights: true,
  max_samples: 256,
  adaptive: true,
  target_error: null,
  deadline_ms: null,
  max_bounces: null,
  seed: 1,
  multiple_scattering: true,
  denoise: false,
  "direct.shading": "pbr",
  "direct.specular": 0.5,
  tone_mapping: "aces",
  exposure: 0,
};

/** Those of the rasterised preview, by their path in a request. */
const PREVIEW_DEFAULTS = {
  "preview.path": "deferred",
  "preview.shading": "pbr",
  "preview.shininess": 32,
  "preview.specular": 0.5,
  "preview.attenuation.kind": "physical",
  "preview.attenuation.constant": 1,
  "preview.attenuation.linear": 0.7,
  "preview.attenuation.quadratic": 1.8,
  "preview.spot_edge": "light",
  "preview.shadows.algorithm": "pcf",
  "preview.shadows.max_lights": 4,
  "preview.shadows.taps": 9,
  "preview.shadows.radius": null,
  "preview.shadows.map_size": 1024,
  "preview.shadows.light_size": 0,
  "preview.shadows.bias.constant": 0.5,
  "preview.shadows.bias.slope": 1,
  "preview.shadows.bias.normal": 0,
  "preview.gizmos": false,
  "preview.gizmo_size": 0.02,
  "preview.samples": 1,
};

/** What the page starts with. `moving`: what is shown while the hand moves, `preview` or `traced`. */
export const START = {
  ...DEFAULTS,
  ...PREVIEW_DEFAULTS,
  width: 960,
  height: 600,
  max_samples: 32,
  transparent: false,
  moving: "preview",
};

/** Fields that each kind of light has, with the API's defaults (`undefined`: always sent). */
const LIGHT_FIELDS = {
  point: { position: undefined, color: [1, 1, 1], intensity: 1, range: null },
  spot: {
    position: undefined,
    direction: undefined,
    color: [1, 1, 1],
    intensity: 1,
    range: null,
    inner_cone_degrees: 0,
    outer_cone_degrees: 45,
    falloff: "gltf",
  },
  directional: { direction: undefined, color: [1, 1, 1], intensity: 1, angular_diameter_degrees: 0, visible: true },
  rect: {
    position: undefined,
    direction: undefined,
    up: [0, 1, 0],
    width: 1,
    height: 1,
    color: [1, 1, 1],
    intensity: 1,
    visible: true,
  },
  disk: { position: undefined, direction: undefined, radius: 0.5, color: [1, 1, 1], intensity: 1, visible: true },
  sphere: { position: undefined, radius: 0.5, color: [1, 1, 1], intensity: 1, visible: true },
  ambient: { color: [1, 1, 1], intensity: 1 },
};

/** Names of the fields that a kind of light has. */
export const lightFields = (type) => Object.keys(LIGHT_FIELDS[type]);

const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);

/** The entries of `values` that `defaults` names and that differ from it. */
function different(values, defaults) {
  return Object.fromEntries(
    Object.keys(defaults)
      .filter((key) => !same(values[key], defaults[key]))
      .map((key) => [key, values[key]]),
  );
}

function lightParams(light) {
  return { type: light.type, ...different(light, LIGHT_FIELDS[light.type]) };
}

/** The maps of a sphere or a material, by the ids of their pictures. */
function mapParams({ texture, detail, relief, scale, method, self_shadow, tiling }) {
  const repeated = different({ tiling }, { tiling: [1, 1] });
  const maps = texture ? { texture: { image: texture.id, ...repeated } } : {};
  if (detail === "none" || !relief) return maps;
  const parallax = detail === "parallax" && different({ method, self_shadow }, { method: "relief", self_shadow: false });
  const map = { image: relief.id, scale, ...repeated, ...parallax };
  return { ...maps, [detail]: map };
}

const given = (values) => Object.fromEntries(Object.entries(values).filter(([, value]) => value !== null));

function sphereParams(sphere) {
  const { center, radius, color, metallic, roughness, reflectivity, shininess } = sphere;
  const gloss = shininess === null ? { roughness } : { shininess };
  return { center, radius, color, metallic, ...gloss, ...given({ reflectivity }), ...mapParams(sphere) };
}

function overrideParams(override) {
  const { material, color, metallic, roughness } = override;
  return { material, ...given({ color, metallic, roughness }), ...mapParams(override) };
}

/** `undefined`: automatic. */
function environmentParams(environment) {
  const { kind } = environment;
  if (kind === "auto" || (kind === "hdri" && !environment.hdri)) return undefined;
  if (kind === "none") return null;
  const source = { [kind]: kind === "hdri" ? environment.hdri.id : environment[kind] };
  return { ...source, ...different(environment, { intensity: 1, rotation_degrees: 0, visible: true }) };
}

/** `{orbit}` or `{index}`, each with a lens. */
function cameraParams(camera) {
  const view = camera.index === null ? camera.orbit.toParams() : { index: camera.index };
  return { ...view, ...different(camera, { aperture_radius: 0, blades: 0, focus_distance: null }) };
}

/** `{"a.b": 1}` as `{a: {b: 1}}`. */
function nested(flat) {
  const root = {};
  for (const [path, value] of Object.entries(flat)) {
    const names = path.split(".");
    const last = names.pop();
    let at = root;
    for (const name of names) at = at[name] ??= {};
    at[last] = value;
  }
  return root;
}

/** The request's `params`. `settings` as START, the others as their panels hold them. */
export function requestParams({ settings, model, camera, motion, lights, spheres, overrides, environment }) {
  const params = {
    ...nested(different(settings, DEFAULTS)),
    ...different(model, { scene: null, variant: null }),
    ...different(motion, { time: null, animation: null, shutter: null }),
  };
  params.camera = cameraParams(camera);
  const shining = lights.filter((light) => light.on).map(lightParams);
  if (shining.length > 0) params.lights = shining;
  const there = spheres.filter((sphere) => sphere.on).map(sphereParams);
  if (there.length > 0) params.spheres = there;
  const changed = overrides.filter((override) => override.on).map(overrideParams);
  if (changed.length > 0) params.overrides = changed;
  const sky = environmentParams(environment);
  if (sky !== undefined) params.environment = sky;
  if (settings.transparent) params.output = { transparent: true };
  return settings.mode === "preview" ? previewParams(params, settings) : params;
}

/** The same picture as the rasteriser draws it. */
export function previewParams(params, settings) {
  // A preview shows one moment, and has no noise.
  const { mode: _, shutter: _shutter, denoise: _denoise, ...others } = params;
  return { ...others, mode: "preview", ...nested(different(settings, PREVIEW_DEFAULTS)) };
}

const DRAFT_WIDTH = { preview: 512, traced: 320 };
const DRAFT_SAMPLES = 4;
const DRAFT_MS = 300;

/** The same picture, small and quick, for the time that a hand moves; `light`: parameters in place of its own. */
export function draftParams(params, settings, light) {
  const { width = DEFAULTS.width, height = DEFAULTS.height } = params;
  const shrink = Math.min(1, DRAFT_WIDTH[settings.moving] / width);
  const small = {
    ...params,
    width: Math.max(1, Math.round(width * shrink)),
    height: Math.max(1, Math.round(height * shrink)),
    max_samples: Math.min(DRAFT_SAMPLES, params.max_samples ?? DEFAULTS.max_samples),
    deadline_ms: DRAFT_MS,
    target_error: null,
    denoise: false,
  };
  return settings.moving === "preview" ? { ...previewParams(small, { ...settings, "preview.samples": 1 }), ...light } : small;
}
