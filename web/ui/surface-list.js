// Spheres of the request, and other values for materials of the file; each with its maps.

import { el } from "./dom.js";
import { OverrideCard, SphereCard } from "./surface-card.js";
import { boundingSphere } from "../math/orbit.js";
import { tidy, tidyAll } from "../math/vector.js";

/** What every surface may have. `texture` and `relief`: uploaded pictures, `{id, name}`. */
const MAPS = { texture: null, detail: "none", relief: null, scale: 1, method: "relief", self_shadow: false };

/** A list of cards with a button that adds one. */
class SurfaceList {
  constructor(element, { name, add, make }, onChange) {
    this.items = [];
    this.make = make;
    this.tell = onChange;
    this.list = el("ul", { class: "cards", "aria-label": name });
    this.addButton = el("button", { type: "button", onclick: () => this.#add() }, add);
    element.append(this.list, el("div", { class: "row" }, this.addButton));
  }

  /** Begins anew with a scene. */
  open(scene) {
    this.scene = scene;
    this.items = [];
    this.#draw();
  }

  #add() {
    this.items.push(this.make.item(this.scene, this.items));
    this.#draw();
    this.list.lastElementChild.querySelector("input, select").focus();
    this.tell(false);
  }

  #remove(item) {
    this.items = this.items.filter((other) => other !== item);
    this.#draw();
    this.addButton.focus();
    this.tell(false);
  }

  #draw() {
    const cards = this.items.map((item, i) =>
      this.make.card(item, { number: i + 1, scene: this.scene, onRemove: () => this.#remove(item) }),
    );
    this.list.replaceChildren(...cards.map(({ element }) => element));
    this.list.hidden = cards.length === 0;
    this.addButton.disabled = !this.make.possible(this.scene);
  }
}

/** Spheres; `onFile(file)` uploads a map and answers `{id, name}`, or nothing if that fails. */
export function sphereList(element, onChange, onFile) {
  const item = (scene, spheres) => {
    const { center, radius } = boundingSphere(scene.bounds);
    const size = tidy(radius / 3, 2);
    // Side by side in front of the scene.
    const [x, y, z] = center;
    const place = [x + (spheres.length % 5) * 2.2 * size, y, z + radius];
    return {
      on: true,
      center: tidyAll(place, 3),
      radius: size,
      color: [0.8, 0.8, 0.8],
      metallic: 0,
      roughness: 0.5,
      reflectivity: null,
      ...MAPS,
      scale: tidy(size / 10, 2),
    };
  };
  const card = (sphere, options) => new SphereCard(sphere, { ...options, onChange, onFile });
  return new SurfaceList(
    element,
    { name: "Spheres", add: "Add sphere", make: { item, card, possible: () => true } },
    onChange,
  );
}

/** Names of the file's materials, each once. */
const materialNames = (scene) => [...new Set(scene.materials.map(({ name }) => name).filter((name) => name))];

/** Overrides of materials. */
export function overrideList(element, onChange, onFile) {
  const item = (scene, overrides) => {
    const names = materialNames(scene);
    const free = names.find((name) => !overrides.some(({ material }) => material === name));
    const scale = tidy(boundingSphere(scene.bounds).radius / 50, 2);
    return {
      on: true,
      material: free ?? names[0],
      color: null,
      metallic: null,
      roughness: null,
      ...MAPS,
      scale,
    };
  };
  const card = (override, options) =>
    new OverrideCard(override, { ...options, names: materialNames(options.scene), onChange, onFile });
  const possible = (scene) => materialNames(scene).length > 0;
  return new SurfaceList(
    element,
    { name: "Materials", add: "Change a material", make: { item, card, possible } },
    onChange,
  );
}
