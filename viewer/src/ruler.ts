/** Lengths for people: the step of a grid, the length of a scale bar, and how to write them. */

/** The largest of 1, 2 and 5 times a power of ten that is no longer than a length [m]. */
export function roundLength(most: number): number {
  const power = 10 ** Math.floor(Math.log10(most));
  const factor = most / power;
  return power * (factor >= 5 ? 5 : factor >= 2 ? 2 : 1);
}

/** A length such as `0.05 m`. */
export function metres(length: number): string {
  return `${Number(length.toPrecision(3))} m`;
}

/** A coordinate with as many decimals as a person compares. */
export function coordinate(value: number): string {
  const text = value.toFixed(4).replace(/\.?0+$/, "");
  return text === "-0" ? "0" : text.replace("-", "−");
}
