// Light of previews: that of the traced picture that they stand in for.

/** The neutral sky of the API, unseen: it stands for surfaces that emit, which light nothing in a preview. */
const UNSEEN_SKY = {
  gradient: { top: [1, 1, 1], horizon: [0.75, 0.75, 0.75], bottom: [0.3, 0.3, 0.3] },
  visible: false,
};

/** What the server chooses light by. */
const choice = (scene, { mode, scene: index, variant, scene_lights, environment, lights }) =>
  JSON.stringify([scene.id, mode, index, variant, scene_lights, environment, Boolean(lights)]);

/** A request may leave its light to the server, which chooses it for each mode by itself; a preview would then be lit otherwise. */
export class PreviewLight {
  #learntOf = null;
  #light = {};

  /** Hears what a traced picture was lit by, in the `defaults` of its report. */
  learn(scene, params, defaults) {
    if (params.mode === "preview" || params.environment !== undefined) return;
    this.#learntOf = choice(scene, params);
    this.#light = PreviewLight.#like(scene, params, Object.fromEntries(defaults.map(({ what, value }) => [what, value])));
  }

  /** Parameters of a preview in place of those of the picture; none where the server chooses the same for both. */
  of(scene, params) {
    return choice(scene, params) === this.#learntOf ? this.#light : {};
  }

  static #like(scene, params, { lights, environment }) {
    if (lights) return { lights, environment: null };
    const ofFile = params.scene_lights !== false && scene.lights.length > 0;
    const emits = environment === null && !params.lights && !ofFile && params.mode !== "direct";
    return emits ? { environment: UNSEEN_SKY } : {};
  }
}
