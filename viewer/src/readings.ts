/** What was measured: numbers by object and quantity over the simulation clock, taken from the results of calls. */

import { fieldInWords, type Names } from "./plain.js";
import type { Exchange } from "./talk.js";

export interface Reading {
  /** Simulation clock [s]. */
  time: number;
  value: number;
}

/** A quantity of an object, by component; a scalar has one, without a name. */
export interface Series {
  name: string;
  /** Empty if it has none. */
  unit: string;
  components: Map<string, Reading[]>;
}

const COMPONENTS = ["x", "y", "z", "w"];
/** Unit by the name of a result's field; the results of a few tools have bare components instead. */
const UNITS: Record<string, string> = {
  position: "m",
  new_position: "m",
  displacement: "m",
  center_of_mass: "m",
  contact_point: "m",
  bounding_box: "m",
  angle: "rad",
  velocity: "m/s",
  approach_speed: "m/s",
  angular_velocity: "rad/s",
  acceleration: "m/s²",
  mass: "kg",
  force: "N",
  torque: "N·m",
  momentum: "kg·m/s",
  angular_momentum: "kg·m²/s",
  kinetic_energy: "J",
  potential_energy: "J",
  rotational_energy: "J",
  sim_time: "s",
  lab_time_left: "s",
};
const BARE: Record<string, string> = { get_acceleration: "acceleration", compute_force: "force" };
/** Fields that are no measurements. */
const COUNTERS = new Set(["sim_time", "steps", "lab_time_left", "calls_left"]);

/** Unit of a field of a result; empty if it has none. */
export function unitOf(tool: string, field: string): string {
  return UNITS[field] ?? (COMPONENTS.includes(field) ? (UNITS[BARE[tool] ?? ""] ?? "") : "");
}

/**
 * All series, the one that was read last first.
 *
 * @param names - What objects are called.
 */
export function seriesOf(exchanges: Exchange[], names: Names = (id) => id): Series[] {
  const found = new Map<string, Series>();
  for (const { arguments: given, content, is_error: failed, tool } of exchanges) {
    const time = content?.["sim_time"];
    if (failed || !content || typeof time !== "number") continue;
    const of = given["object_id"];
    const prefix = typeof of === "string" ? `${names(of)} ` : typeof of === "number" ? `${names(`object_${of}`)} ` : "";
    for (const [field, value] of Object.entries(content)) {
      if (COUNTERS.has(field)) continue;
      const bare = BARE[tool] !== undefined && COMPONENTS.includes(field);
      const quantity = bare ? BARE[tool]! : field.replace(/^new_/, "");
      const name = `${prefix}${quantity.replaceAll("_", " ")}`;
      for (const [part, number] of numbersIn(value)) {
        const series = found.get(name) ?? { name, unit: unitOf(tool, field), components: new Map<string, Reading[]>() };
        const component = bare ? field : part;
        series.components.set(component, [...(series.components.get(component) ?? []), { time, value: number }]);
        found.delete(name);
        found.set(name, series);
      }
    }
  }
  return [...found.values()].reverse();
}

/** The series of which some component changed, with these components alone. */
export function changedOf(series: Series[]): Series[] {
  return series
    .map((one) => ({ ...one, components: new Map([...one.components].filter(([, readings]) => changes(readings))) }))
    .filter((one) => one.components.size > 0);
}

function changes(readings: Reading[]): boolean {
  const values = readings.map(({ value }) => value);
  const [low, high] = [Math.min(...values), Math.max(...values)];
  return high - low > 1e-9 * Math.max(1e-3, Math.abs(low), Math.abs(high));
}

function numbersIn(value: unknown): [string, number][] {
  if (typeof value === "number") return [["", value]];
  if (Array.isArray(value) && value.length <= 4 && value.every((one) => typeof one === "number")) {
    const names = value.length === 4 ? ["w", "x", "y", "z"] : COMPONENTS;
    return (value as number[]).map((one, index) => [names[index]!, one]);
  }
  if (value && typeof value === "object" && !Array.isArray(value)) {
    return Object.entries(value).filter((one): one is [string, number] => typeof one[1] === "number");
  }
  return [];
}

/** The last reading of each quantity of an object, in lines. */
export function latestOf(exchanges: Exchange[], object: string): string[] {
  const found = new Map<string, string>();
  for (const { arguments: given, content, is_error: failed, tool } of exchanges) {
    if (failed || !content || given["object_id"] !== object) continue;
    for (const [name, value] of Object.entries(content)) {
      if (name === "sim_time" || value === null || typeof value === "string") continue;
      found.set(name, `${measured(tool, name, value)} at ${shortened(content["sim_time"])} s`);
    }
  }
  return [...found.values()];
}

/** A field of a result in words, such as `velocity [0, 0, -7.848] m/s`. */
export function measured(tool: string, field: string, value: unknown): string {
  return [fieldInWords(field), shortened(value), unitOf(tool, field)].filter((part) => part !== "").join(" ");
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
