// Which scene of the file is shown, and which variant of its materials; hidden where the file leaves no choice.

import { SelectField } from "./fields.js";

const USUAL = "usual";

export class ModelPanel {
  /** Index of a scene other than the file's default, and the name of a variant; both null: as the file has it. */
  model = { scene: null, variant: null };

  /** `section` holds `element`; `onChange(isOtherScene)`. */
  constructor(section, element, onChange) {
    this.section = section;
    this.element = element;
    this.onChange = onChange;
  }

  /** Begins with what the file shows by default. */
  open({ scenes, default_scene: usual, variants }) {
    this.model = { scene: null, variant: null };
    this.section.hidden = scenes.length < 2 && variants.length === 0;
    const fields = {};
    if (scenes.length > 1) {
      const options = scenes.map(({ index, name }) => [String(index), name ?? `Scene ${index + 1}`]);
      fields.scene = new SelectField("Scene", { value: String(usual), options }, (value) =>
        this.#change({ scene: Number(value) === usual ? null : Number(value) }, true),
      );
    }
    if (variants.length > 0) {
      const options = [[USUAL, "None"], ...variants.map((name, i) => [String(i), name])];
      fields.variant = new SelectField("Variant", { value: USUAL, options }, (value) =>
        this.#change({ variant: variants[value] ?? null }, false),
      );
    }
    for (const [name, { element }] of Object.entries(fields)) element.dataset.setting = name;
    this.element.replaceChildren(...Object.values(fields).map(({ element }) => element));
  }

  #change(changes, isOtherScene) {
    this.model = { ...this.model, ...changes };
    this.onChange(isOtherScene);
  }
}
