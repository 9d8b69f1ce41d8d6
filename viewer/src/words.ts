/** What is seen, in words: for people who cannot see the picture, and for the text at the pointer. */

import { type Body, type Drawing, type Part, type Pose, type Reading, titleOf, type View } from "./drawing.js";
import { coordinate, metres } from "./ruler.js";

/** A part in words, with its full edges. */
export function partInWords({ shape, size: [a, b, c] }: Part): string {
  switch (shape) {
    case "sphere":
      return `sphere, radius ${metres(a)}`;
    case "box":
      return `box, ${[a, b, c].map((half) => Number((2 * half).toPrecision(3))).join(" × ")} m`;
    case "ellipsoid":
      return `ellipsoid, ${[a, b, c].map((half) => Number((2 * half).toPrecision(3))).join(" × ")} m`;
    case "capsule":
    case "cylinder":
      return `${shape}, radius ${metres(a)}, length ${metres(2 * b)}`;
    case "plane":
      return "plane";
  }
}

/** A body in words. */
export function bodyInWords(body: Body): string {
  const [part, ...others] = body.parts;
  if (!part) return "nothing";
  return others.length > 0 ? `${body.parts.length} shapes, the first a ${partInWords(part)}` : partInWords(part);
}

/** A position in words. */
export function placeInWords(pose: Pose): string {
  return `(${pose.slice(0, 3).map(coordinate).join(", ")}) m`;
}

/** A reading in words, such as `last read (0.25, 0, 0.5) m at 1.2 s`. */
export function readingInWords({ position, angle, time }: Reading): string {
  const turned = angle === undefined ? "" : `, ${coordinate(angle)} rad,`;
  return `last read (${position.map(coordinate).join(", ")}) m${turned} at ${Number(time.toPrecision(6))} s`;
}

/** What of a drawing is drawn after the words of the task alone; empty if nothing is. */
export function schematicInWords({ schematic = [] }: Drawing): string {
  const kinds = [...new Set(schematic.map((course) => course.kind))];
  return kinds.length > 0 ? `Drawn after the words of the task, not to scale: ${kinds.join(", ")}.` : "";
}

/** By how much a pose is turned from the world axes, in words. */
export function turnInWords(pose: Pose): string {
  const [w, x, y, z] = pose.slice(3) as [number, number, number, number];
  const sine = Math.hypot(x, y, z);
  const degrees = (2 * Math.atan2(sine, Math.abs(w)) * 180) / Math.PI;
  if (degrees < 0.05) return "not turned";
  const sign = w < 0 ? -1 : 1;
  const axis = [x, y, z].map((value) => coordinate(Number(((sign * value) / sine).toFixed(2))));
  return `turned ${degrees.toFixed(1)}° about (${axis.join(", ")})`;
}

/**
 * A view in one sentence or two.
 *
 * @param view - What is seen.
 * @param places - Whether to tell where things are.
 * @param names - What objects are called.
 */
export function viewInWords(view: View, places = true, names = (id: string) => titleOf(view.drawing, id)): string {
  const objects = view.drawing.bodies.filter((body) => body.object);
  const read = Object.entries(view.read ?? {}).map(([id, reading]) => `${names(id)}, not watched, ${readingInWords(reading)}`);
  const nothing = view.drawing.bodies.length === 0;
  if (nothing && read.length === 0) return NOTHING;
  const listed = objects.map((body) => {
    const pose = view.poses[body.id];
    return `${names(body.id)}, ${bodyInWords(body)}${pose && places ? ` at ${placeInWords(pose)}` : ""}`;
  });
  const moved = Object.keys(view.motion?.poses ?? {}).map(names);
  const motion = moved.length > 0 ? ` In the last step moved: ${moved.join(", ")}.` : "";
  const seen = listed.join("; ") || (nothing ? "nothing" : "fixtures only");
  return `At ${coordinate(view.time)} s are seen: ${[seen, ...read].join("; ")}.${motion}`;
}

export const STILL = "Nothing that is seen moved in this step.";

export const NOTHING =
  "Nothing of this scene may be seen: its objects are hidden, or what would show them is withheld or differs from" +
  " case to case. Measure with the tools.";
