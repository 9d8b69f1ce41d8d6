/** The limits of an episode, and whether calls would go beyond them. The laboratory has the last word. */

import { shortened } from "./readings.js";
import type { Call, Exchange, Limits } from "./talk.js";

/** Simulated time of an episode whose scene says nothing else [s]. */
const USUAL_LAB_TIME = 3600;

/** The limits with what is left of them, in words; only those that the scene states. */
export function limitsInWords(limits: Limits, exchanges: Exchange[]): string[] {
  const left = leftOf(limits, exchanges);
  const found: string[] = [];
  for (const [what, most, unit] of [
    ["force", limits.force, "N"],
    ["torque", limits.torque, "N·m"],
  ] as const) {
    if (most !== undefined) found.push(most === 0 ? `no ${what}` : `${what} at most ${shortened(most)} ${unit}`);
  }
  if (limits.created_mass !== undefined) {
    found.push(`created mass ${shortened(round(left.mass))} of ${shortened(limits.created_mass)} kg left`);
  }
  if (limits.lab_time !== undefined) {
    found.push(`laboratory time ${shortened(round(left.time))} of ${shortened(limits.lab_time)} s left`);
  }
  if (limits.calls !== undefined) found.push(`${left.calls} of ${limits.calls} calls left`);
  return found;
}

/** Why the laboratory would refuse these calls, in a sentence; null if no limit speaks against them. */
export function beyond(calls: Call[], limits: Limits, exchanges: Exchange[]): string | null {
  const left = leftOf(limits, exchanges);
  const made = calls.filter((call) => call.tool !== "answer");
  if (made.length > left.calls) return `${made.length} calls, and ${left.calls} are left`;
  const time = made.reduce((sum, call) => sum + (call.tool === "step" ? numberAt(call, "duration") : 0), 0);
  if (time > left.time + 1e-9) {
    return `step: ${shortened(round(time))} s, and ${shortened(round(left.time))} s of laboratory time are left`;
  }
  const mass = made.reduce((sum, call) => sum + massOf(call), 0);
  if (mass > left.mass * (1 + 1e-9)) {
    return `create_objects: ${shortened(round(mass))} kg, and ${shortened(round(left.mass))} kg are left`;
  }
  for (const call of made) {
    const [what, most, unit] =
      call.tool === "apply_force" ? ["force", limits.force, "N"] : ["torque", limits.torque, "N·m"];
    const vector = call.arguments[`${what}_vector`];
    if (most === undefined || !Array.isArray(vector)) continue;
    const size = Math.hypot(...(vector as number[]));
    if (size <= (most as number) * (1 + 1e-9)) continue;
    return `${call.tool}: a ${what} of ${shortened(round(size))} ${unit}, and the limit is ${shortened(most)} ${unit}`;
  }
  return null;
}

function leftOf(limits: Limits, exchanges: Exchange[]): { calls: number; time: number; mass: number } {
  const done = exchanges.filter((one) => one.returned);
  const told = done.map((one) => one.content?.["lab_time_left"]).filter((one) => typeof one === "number");
  const made = done.filter((one) => !one.is_error).reduce((sum, one) => sum + massOf(one), 0);
  return {
    calls: (limits.calls ?? Infinity) - done.filter((one) => one.tool !== "answer").length,
    time: told.at(-1) ?? limits.lab_time ?? USUAL_LAB_TIME,
    mass: (limits.created_mass ?? Infinity) - made,
  };
}

/** Mass of the sphere that a call creates [kg]; 0 for other calls. */
function massOf(call: Call): number {
  if (call.tool !== "create_objects") return 0;
  return (numberAt(call, "density") * 4 * Math.PI * numberAt(call, "radius", 0.1) ** 3) / 3;
}

function numberAt(call: Call, name: string, usual = 0): number {
  const value = call.arguments[name];
  return typeof value === "number" ? value : usual;
}

function round(value: number): number {
  return Number(value.toPrecision(6));
}
