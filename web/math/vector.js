// Three numbers in an array.

export const add = (a, b) => a.map((x, i) => x + b[i]);
export const subtract = (a, b) => a.map((x, i) => x - b[i]);
export const scale = (a, s) => a.map((x) => x * s);
export const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
export const length = (a) => Math.hypot(...a);

/** Rounded for people: as many digits as a picture can show, and no `-0`. */
export const tidy = (x, digits = 5) => Number(x.toPrecision(digits)) + 0;
export const tidyAll = (a, digits) => a.map((x) => tidy(x, digits));
