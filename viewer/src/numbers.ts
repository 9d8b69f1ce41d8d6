/** Numbers as people type them. */

import type { Schema } from "./talk.js";

/**
 * The number in a field; throws a sentence if it holds none, or one that its schema refuses.
 *
 * @param name - What the sentence calls the field.
 * @param written - What was typed; a comma may be the decimal sign.
 * @param schema - Its bounds.
 */
export function numberFrom(name: string, written: string, schema: Schema = {}): number {
  const trimmed = written.trim();
  // Three digits after a comma may be decimals or thousands, and a wrong guess would cost an experiment.
  if (/^[-−+]?\d{1,3},\d{3}$/.test(trimmed)) {
    const ways = `${trimmed.replace(",", ".")} or ${trimmed.replace(",", "")}`;
    throw new Error(`${name}: ${trimmed} can be read in two ways; write ${ways}`);
  }
  const typed = trimmed.replace(",", ".").replace("−", "-");
  const value = Number(typed);
  if (typed === "" || !Number.isFinite(value)) throw new Error(`${name}: ${typed || "nothing"} is not a number`);
  const { minimum, maximum, exclusiveMinimum } = schema;
  if (minimum !== undefined && value < minimum) throw new Error(`${name}: ${value} is less than ${minimum}`);
  if (exclusiveMinimum !== undefined && value <= exclusiveMinimum) {
    throw new Error(`${name}: ${value} is not more than ${exclusiveMinimum}`);
  }
  if (maximum !== undefined && value > maximum) throw new Error(`${name}: ${value} is more than ${maximum}`);
  return value;
}
