/** Poses between the instants of a motion. Knows no pictures. */

import type { Motion, Pose, Poses } from "./drawing.js";

/** Duration of a motion [s]. */
export function durationOf(motion: Motion): number {
  return (motion.times.at(-1) ?? 0) - (motion.times[0] ?? 0);
}

/**
 * The poses at an instant; bodies that do not move keep theirs.
 *
 * @param motion - The motion.
 * @param still - The poses of all bodies.
 * @param time - The instant [s]; before the first and after the last one, theirs is taken.
 */
export function posesAt(motion: Motion, still: Poses, time: number): Poses {
  const { times } = motion;
  const after = times.findIndex((instant) => instant >= time);
  const last = after < 0 ? times.length - 1 : after;
  const first = Math.max(0, last - 1);
  const from = times[first] ?? 0;
  const span = (times[last] ?? 0) - from;
  const share = span > 0 ? Math.min(1, Math.max(0, (time - from) / span)) : 1;
  const found: Poses = { ...still };
  for (const [id, course] of Object.entries(motion.poses)) {
    const before = course[first];
    const next = course[last];
    if (before && next) found[id] = between(before, next, share);
  }
  return found;
}

/** The pose at a share of the way: a straight line, and the shorter turn, normalised. */
export function between(first: Pose, second: Pose, share: number): Pose {
  const aligned = first.slice(3).reduce((sum, value, index) => sum + value * (second[index + 3] ?? 0), 0) < 0 ? -1 : 1;
  const mixed = first.map((value, index) => {
    const target = (second[index] ?? 0) * (index < 3 ? 1 : aligned);
    return value + (target - value) * share;
  });
  const length = Math.hypot(...mixed.slice(3)) || 1;
  return mixed.map((value, index) => (index < 3 ? value : value / length)) as Pose;
}
