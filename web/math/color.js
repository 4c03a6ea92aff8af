// sRGB, as colour inputs speak it, and linear Rec. 709, as the API does.

const decode = (c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
const encode = (c) => (c <= 0.0031308 ? c * 12.92 : 1.055 * c ** (1 / 2.4) - 0.055);

/** `#rrggbb` -> linear triple, to four significant digits (enough to come back to the same `#rrggbb`). */
export function hexToLinear(hex) {
  return [1, 3, 5].map((at) => Number(decode(parseInt(hex.slice(at, at + 2), 16) / 255).toPrecision(4)));
}

/** Linear triple -> `#rrggbb`, clipped to 0..1. */
export function linearToHex(linear) {
  const byte = (c) => Math.round(encode(Math.min(Math.max(c, 0), 1)) * 255);
  return `#${linear.map((c) => byte(c).toString(16).padStart(2, "0")).join("")}`;
}
