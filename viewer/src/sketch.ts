/**
 * What is drawn over a picture as lines, and is no body: dashed rings where objects that are not watched were read last,
 * and the cords, springs, rods, rails and pulleys of the task. Nothing else is known of them, so none has a true size.
 */

import type { Course, Drawing, Poses, Reading, Readings, Triple } from "./drawing.js";

const SVG = "http://www.w3.org/2000/svg";
const RING_PX = 11;
const PULLEY_PX = 9;
/** Half distance of the two lines of a rail. */
const RAIL_PX = 2.5;
const COIL_PX = 6;
const COILS = 9;
/** Share of a spring that is straight, at each end. */
const STRAIGHT = 0.12;

type Flat = [number, number];
/** Where a point of the world is in the picture [px]; null if it is behind the camera. */
export type Seen = (point: Triple) => Flat | null;

/** Objects that were read and are not drawn, with their readings. */
export function unseenOf(drawing: Drawing, read: Readings): [string, Reading][] {
  const drawn = new Set(drawing.bodies.map((body) => body.id));
  return Object.entries(read).filter(([id]) => !drawn.has(id));
}

export class Sketch {
  readonly element = document.createElementNS(SVG, "g");

  /** Draw all anew. */
  draw(seen: Seen, drawing: Drawing, poses: Poses, read: Readings): void {
    const unseen = unseenOf(drawing, read);
    const places = new Map<string, Triple>(unseen.map(([id, { position }]) => [id, position]));
    for (const [id, [x, y, z]] of Object.entries(poses)) places.set(id, [x, y, z]);
    const courses = (drawing.schematic ?? []).map((course) => courseOf(course, places, seen));
    const rings = unseen.map(([, { position }]) => ringAt(seen(position), RING_PX, "lab-read"));
    this.element.replaceChildren(...[...courses, ...rings].filter((shape) => shape !== null));
  }
}

/** A part of the task; null while an end of it is unknown. */
function courseOf({ kind, points }: Course, places: Map<string, Triple>, seen: Seen): SVGElement | null {
  const known = points.map((point) => (typeof point === "string" ? places.get(point) : point));
  const flat = known.map((point) => (point ? seen(point) : null)).filter((point) => point !== null);
  if (flat.length < points.length) return null;
  if (kind === "pulley") return ringAt(flat[0]!, PULLEY_PX, "lab-pulley");
  const lines = kind === "rail" ? [-RAIL_PX, RAIL_PX].map((side) => beside(flat, side)) : [flat];
  const drawn = kind === "spring" ? lines.map(coiled) : lines;
  const path = document.createElementNS(SVG, "path");
  path.setAttribute("class", `lab-${kind}`);
  path.setAttribute("d", drawn.map((line) => `M${line.map((point) => point.join(" ")).join("L")}`).join(""));
  return path;
}

function ringAt(middle: Flat | null, radius: number, name: string): SVGElement | null {
  if (!middle) return null;
  const ring = document.createElementNS(SVG, "circle");
  ring.setAttribute("class", name);
  ring.setAttribute("cx", `${middle[0]}`);
  ring.setAttribute("cy", `${middle[1]}`);
  ring.setAttribute("r", `${radius}`);
  return ring;
}

/** A line moved sideways [px]. */
function beside(line: Flat[], side: number): Flat[] {
  const [across, down] = normal(line[0]!, line.at(-1)!);
  return line.map(([x, y]) => [x + side * across, y + side * down]);
}

/** A zigzag between the first and the last point of a line. */
function coiled(line: Flat[]): Flat[] {
  const [from, to] = [line[0]!, line.at(-1)!];
  const [across, down] = normal(from, to);
  const at = (share: number, side: number): Flat => [
    from[0] + share * (to[0] - from[0]) + side * across,
    from[1] + share * (to[1] - from[1]) + side * down,
  ];
  const turns = Array.from({ length: 2 * COILS }, (_, index) =>
    at(STRAIGHT + ((1 - 2 * STRAIGHT) * (index + 0.5)) / (2 * COILS), index % 2 === 0 ? COIL_PX : -COIL_PX),
  );
  return [from, at(STRAIGHT, 0), ...turns, at(1 - STRAIGHT, 0), to];
}

/** A unit vector across a line; 0 if the line is a point. */
function normal([x, y]: Flat, [toX, toY]: Flat): Flat {
  const length = Math.hypot(toX - x, toY - y) || Infinity;
  return [-(toY - y) / length, (toX - x) / length];
}
