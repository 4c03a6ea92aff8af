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
  tone_mapping: "aces",
  exposure: 0,
};

/** What the page starts with. */
export const START = { ...DEFAULTS, width: 960, height: 600, max_samples: 32, transparent: false };

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
  directional: { direction: undefined, color: [1, 1, 1], intensity: 1 },
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
  return { ...view, ...different(camera, { aperture_radius: 0, focus_distance: null }) };
}

/** The request's `params`. `settings` as START, `camera`, `lights` and `environment` as their panels hold them. */
export function requestParams({ settings, camera, lights, environment }) {
  const params = different(settings, DEFAULTS);
  params.camera = cameraParams(camera);
  const shining = lights.filter((light) => light.on).map(lightParams);
  if (shining.length > 0) params.lights = shining;
  const sky = environmentParams(environment);
  if (sky !== undefined) params.environment = sky;
  if (settings.transparent) params.output = { transparent: true };
  return params;
}

const DRAFT_WIDTH = 320;
const DRAFT_SAMPLES = 4;
const DRAFT_MS = 300;

/** The same picture, small and quick, for the time that a hand moves. */
export function draftParams(params) {
  const { width = DEFAULTS.width, height = DEFAULTS.height } = params;
  const shrink = Math.min(1, DRAFT_WIDTH / width);
  return {
    ...params,
    width: Math.max(1, Math.round(width * shrink)),
    height: Math.max(1, Math.round(height * shrink)),
    max_samples: Math.min(DRAFT_SAMPLES, params.max_samples ?? DEFAULTS.max_samples),
    deadline_ms: DRAFT_MS,
    target_error: null,
  };
}
