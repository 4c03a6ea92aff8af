// A camera on a sphere around its target, as in the API's `camera.orbit`. Values are never changed in place.

import { add, dot, length, scale, subtract, tidy, tidyAll } from "./vector.js";
import { fromAngles, radians, toAngles } from "./sphere.js";

/** Short of the poles, where up would be undefined. */
const STEEPEST = 89;
const clampElevation = (degrees) => Math.min(Math.max(degrees, -STEEPEST), STEEPEST);

/** Centre and radius of the sphere around a box `{min, max}`. */
export function boundingSphere({ min, max }) {
  return { center: scale(add(min, max), 0.5), radius: length(subtract(max, min)) / 2 || 1 };
}

/** Nearest and farthest that a zoom comes, in radii of the scene. */
const NEAREST = 1e-3;
const FARTHEST = 1e3;

export class Orbit {
  /**
   * Angles in degrees, lengths in scene units. `framed`: the server finds target and distance such that all is in the picture; those
   * here are a guess.
   */
  constructor({ target, azimuth, elevation, distance, yfov, framed = false }) {
    Object.assign(this, { target, azimuth, elevation, distance, yfov, framed });
  }

  /** The whole box in a picture of `aspect` = width / height. */
  static framing(bounds, aspect, { azimuth = 30, elevation = 20, yfov = 45, framed = false } = {}) {
    const { center, radius } = boundingSphere(bounds);
    const half = radians(yfov) / 2;
    const narrower = Math.min(half, Math.atan(Math.tan(half) * aspect));
    return new Orbit({ target: center, azimuth, elevation, distance: radius / Math.sin(narrower), yfov, framed });
  }

  /** Continues from a camera given by position and view direction; its target is at the depth of the scene's centre. */
  static fromCamera({ position, direction, yfov }, bounds) {
    const { center, radius } = boundingSphere(bounds);
    const forward = scale(direction, 1 / (length(direction) || 1));
    const depth = dot(subtract(center, position), forward);
    const distance = depth > radius * 0.01 ? depth : radius;
    const { azimuth, elevation } = toAngles(scale(forward, -1));
    const target = add(position, scale(forward, distance));
    return new Orbit({ target, azimuth, elevation: clampElevation(elevation), distance, yfov });
  }

  /** With other values, and so no longer framed. */
  with(changes) {
    return new Orbit({ ...this, framed: false, ...changes });
  }

  /** Turns by a drag of (dx, dy) picture heights: the scene follows the hand. */
  turned(dx, dy) {
    const elevation = clampElevation(this.elevation + dy * 180);
    const azimuth = ((((this.azimuth - dx * 180 + 180) % 360) + 360) % 360) - 180;
    return this.with({ azimuth, elevation });
  }

  /** Shifts by a drag of (dx, dy) picture heights: what lies at the target's depth follows the hand. */
  panned(dx, dy) {
    const right = fromAngles(this.azimuth + 90, 0);
    const up = fromAngles(this.azimuth, this.elevation + 90);
    const height = 2 * this.distance * Math.tan(radians(this.yfov) / 2);
    return this.with({ target: add(this.target, add(scale(right, -dx * height), scale(up, dy * height))) });
  }

  /** Comes `factor` times as near to a scene of this radius; who is beyond a limit already comes no further. */
  zoomed(factor, radius) {
    const nearest = Math.min(NEAREST * radius, this.distance);
    const farthest = Math.max(FARTHEST * radius, this.distance);
    return this.with({ distance: Math.min(Math.max(this.distance / factor, nearest), farthest) });
  }

  /** The API's camera. */
  toParams() {
    const angles = { azimuth_degrees: tidy(this.azimuth), elevation_degrees: tidy(this.elevation) };
    const yfov_degrees = tidy(this.yfov);
    if (this.framed) return { orbit: angles, yfov_degrees };
    return { orbit: { ...angles, distance: tidy(this.distance) }, target: tidyAll(this.target), yfov_degrees };
  }
}
