// Directions as two angles: azimuth turns about +y from +z towards +x, elevation rises above the horizon.

export const radians = (degrees) => (degrees * Math.PI) / 180;
export const degrees = (radians) => (radians * 180) / Math.PI;

/** Unit vector of two angles in degrees. */
export function fromAngles(azimuth, elevation) {
  const [a, e] = [radians(azimuth), radians(elevation)];
  return [Math.sin(a) * Math.cos(e), Math.sin(e), Math.cos(a) * Math.cos(e)];
}

/** Angles in degrees of a vector that is not zero. */
export function toAngles([x, y, z]) {
  return { azimuth: degrees(Math.atan2(x, z)), elevation: degrees(Math.atan2(y, Math.hypot(x, z))) };
}
