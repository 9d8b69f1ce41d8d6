/** What was measured: numbers by object and quantity over the simulation clock, taken from the results of calls. */

import type { Exchange } from "./talk.js";

export interface Reading {
  /** Simulation clock [s]. */
  time: number;
  value: number;
}

const COMPONENTS = ["x", "y", "z", "w"];

/** Series by name, such as `object_1 position.z`, in the order of their first reading. */
export function seriesOf(exchanges: Exchange[]): Map<string, Reading[]> {
  const found = new Map<string, Reading[]>();
  for (const { arguments: given, content, is_error: failed, tool } of exchanges) {
    const time = content?.["sim_time"];
    if (failed || !content || typeof time !== "number" || tool === "step") continue;
    const of = given["object_id"];
    const prefix = typeof of === "string" || typeof of === "number" ? `${of} ` : "";
    for (const [name, value] of Object.entries(content)) {
      if (name === "sim_time") continue;
      for (const [part, number] of numbersIn(value)) {
        const key = `${prefix}${name}${part}`;
        found.set(key, [...(found.get(key) ?? []), { time, value: number }]);
      }
    }
  }
  return found;
}

function numbersIn(value: unknown): [string, number][] {
  if (typeof value === "number") return [["", value]];
  if (Array.isArray(value) && value.length <= 4 && value.every((one) => typeof one === "number")) {
    const names = value.length === 4 ? ["w", "x", "y", "z"] : COMPONENTS;
    return (value as number[]).map((one, index) => [`.${names[index]}`, one]);
  }
  if (value && typeof value === "object" && !Array.isArray(value)) {
    return Object.entries(value).flatMap(([name, one]) =>
      typeof one === "number" ? [[`.${name}`, one] as [string, number]] : [],
    );
  }
  return [];
}

/** The last reading of each quantity of an object, in lines. */
export function latestOf(exchanges: Exchange[], object: string): string[] {
  const found = new Map<string, string>();
  for (const { arguments: given, content, is_error: failed } of exchanges) {
    if (failed || !content || given["object_id"] !== object) continue;
    for (const [name, value] of Object.entries(content)) {
      if (name === "sim_time" || value === null || typeof value === "string") continue;
      found.set(name, `${name} ${shortened(value)} at ${shortened(content["sim_time"])} s`);
    }
  }
  return [...found.values()];
}

/** A value for a person: eight digits hide arithmetic noise, and nothing that was measured. */
export function shortened(value: unknown): string {
  if (typeof value === "number") return `${Number(value.toPrecision(8))}`;
  if (Array.isArray(value)) return `[${value.map(shortened).join(", ")}]`;
  if (value && typeof value === "object") {
    return Object.entries(value)
      .map(([name, one]) => `${name} ${shortened(one)}`)
      .join(", ");
  }
  return value === null ? "n/a" : `${value as string}`;
}
