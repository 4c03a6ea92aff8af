// Spheres of the request, and other values for materials of the file; each with its maps.

import { el, newId } from "./dom.js";
import { OverrideCard, SphereCard } from "./surface-card.js";
import { boundingSphere } from "../math/orbit.js";
import { add, tidy, tidyAll } from "../math/vector.js";

/** What every surface may have. `texture` and `relief`: uploaded pictures, `{id, name, file}`. */
const MAPS = { texture: null, detail: "none", relief: null, scale: 1, method: "relief", self_shadow: false, tiling: [1, 1] };

/** New spheres stand in rows of so many, so far apart (in radii). */
const ROW = 5;
const APART = 2.2;

/** A list of cards with a button that adds one. `make`: an `item`, its `card`, and a `refusal` that says why no other can be added. */
class SurfaceList {
  constructor(element, { name, add, make }, onChange) {
    this.items = [];
    this.make = make;
    this.tell = onChange;
    this.list = el("ul", { class: "cards", "aria-label": name });
    this.hint = el("p", { class: "hint", id: newId() });
    const named = { type: "button", "aria-describedby": this.hint.id, onclick: () => this.#add() };
    this.addButton = el("button", named, add);
    element.append(this.list, el("div", { class: "row" }, this.addButton), this.hint);
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

  /** Draws all cards anew after one got another name, as what the others may choose from has changed. */
  #rename(item) {
    this.#draw();
    this.list.children[this.items.indexOf(item)].querySelector("select").focus();
  }

  #draw() {
    const cards = this.items.map((item, i) =>
      this.make.card(item, {
        number: i + 1,
        scene: this.scene,
        items: this.items,
        onRename: () => this.#rename(item),
        onRemove: () => this.#remove(item),
      }),
    );
    this.list.replaceChildren(...cards.map(({ element }) => element));
    this.list.hidden = cards.length === 0;
    const refusal = this.make.refusal(this.scene, this.items);
    this.addButton.disabled = Boolean(refusal);
    this.hint.textContent = refusal;
    this.hint.hidden = !refusal;
  }
}

/** The first place of some rows in front of the scene where no sphere was put yet. */
function freePlace(scene, spheres, size) {
  const { center, radius } = boundingSphere(scene.bounds);
  const place = (n) => {
    const [across, up] = [n % ROW, Math.floor(n / ROW)].map((steps) => steps * APART * size);
    return tidyAll(add(center, [across, up, radius]), 3);
  };
  const taken = new Set(spheres.map((sphere) => String(sphere.center)));
  let n = 0;
  while (taken.has(String(place(n)))) n += 1;
  return place(n);
}

/** Spheres; `onFile(file)` uploads a map and answers `{id, name, file}`, or nothing if that fails. */
export function sphereList(element, onChange, onFile) {
  const item = (scene, spheres) => {
    const size = tidy(boundingSphere(scene.bounds).radius / 3, 2);
    const relief = tidy(size / 10, 2);
    return {
      on: true,
      usual: { radius: size, relief },
      center: freePlace(scene, spheres, size),
      radius: size,
      color: [0.8, 0.8, 0.8],
      metallic: 0,
      roughness: 0.5,
      reflectivity: null,
      shininess: null,
      ...MAPS,
      scale: relief,
    };
  };
  const card = (sphere, options) => new SphereCard(sphere, { ...options, onChange, onFile });
  return new SurfaceList(
    element,
    { name: "Spheres", add: "Add sphere", make: { item, card, refusal: () => "" } },
    onChange,
  );
}

/** Names of the file's materials, each once. */
const materialNames = (scene) => [...new Set(scene.materials.map(({ name }) => name).filter((name) => name))];

/** Those that no other card changes. */
const freeNames = (scene, others) =>
  materialNames(scene).filter((name) => !others.some(({ material }) => material === name));

function refusal(scene, overrides) {
  if (scene.materials.length === 0) return "This file has no materials.";
  if (materialNames(scene).length === 0) return "The materials of this file have no names, by which to tell them apart.";
  return freeNames(scene, overrides).length === 0 ? "Each named material has its card." : "";
}

/** Overrides of materials. */
export function overrideList(element, onChange, onFile) {
  const item = (scene, overrides) => {
    const relief = tidy(boundingSphere(scene.bounds).radius / 50, 2);
    return {
      on: true,
      usual: { relief },
      material: freeNames(scene, overrides)[0],
      color: null,
      metallic: null,
      roughness: null,
      ...MAPS,
      scale: relief,
    };
  };
  const card = (override, { scene, items, ...options }) => {
    const others = items.filter((other) => other !== override);
    return new OverrideCard(override, { ...options, names: freeNames(scene, others), onChange, onFile });
  };
  return new SurfaceList(
    element,
    { name: "Materials", add: "Change a material", make: { item, card, refusal } },
    onChange,
  );
}
