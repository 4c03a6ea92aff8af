// Which moment of which animation is shown; hidden where the file has none.

import { SelectField, SliderField } from "./fields.js";

const REST = "rest";

export class MotionPanel {
  /** `time` in seconds of `animation`, an index; both null: the scene as the file stores it. `shutter`: open around that time. */
  motion = { time: null, animation: null, shutter: null };

  /** `section` holds `element`; `onChange(live)`. */
  constructor(section, element, onChange) {
    this.section = section;
    this.element = element;
    this.onChange = onChange;
  }

  /** Begins with a scene at rest. */
  open({ animations }) {
    this.animations = animations;
    this.motion = { time: null, animation: null, shutter: null };
    this.section.hidden = animations.length === 0;
    const named = animations.map(({ name }, i) => [String(i), name ?? `Animation ${i + 1}`]);
    const options = [[REST, "None (at rest)"], ...named];
    this.choice = new SelectField("Animation", { value: REST, options }, (value) => this.#choose(value));
    this.choice.element.dataset.setting = "animation";
    this.element.replaceChildren(this.choice.element);
  }

  #choose(value) {
    const animation = value === REST ? null : Number(value);
    const { start_seconds: min, end_seconds: max } = this.animations[animation] ?? {};
    this.motion = { time: animation === null ? null : min, animation, shutter: null };
    const fields = [this.choice];
    if (animation !== null && max > min) {
      const range = { value: min, min, max, unit: "s" };
      const time = new SliderField("Time", range, (seconds, live) => {
        this.motion = { ...this.motion, time: seconds };
        this.onChange(live);
      });
      time.element.dataset.setting = "time";
      const shutter = new SliderField("Shutter", { value: 0, min: 0, max: 0.1, unit: "s" }, (seconds, live) => {
        const open = { open: -seconds / 2, close: seconds / 2 };
        this.motion = { ...this.motion, shutter: seconds > 0 ? open : null };
        this.onChange(live);
      });
      shutter.element.dataset.setting = "shutter";
      fields.push(time, shutter);
    }
    this.element.replaceChildren(...fields.map(({ element }) => element));
    this.onChange(false);
  }
}
