/**
 * Where the camera is, computed from what is drawn as `physment_mcp/world/pictures` does: all things whole, and the near
 * parts of the fixtures around them. Knows no graphics library.
 */

import type { Body, Drawing, Part, Pose, Poses, Quaternion, Triple } from "./drawing.js";

/** The camera looks from -y, a little from the right and from above: x points to the right, z up. */
const AZIMUTH = (106 * Math.PI) / 180;
const ELEVATION = (-15 * Math.PI) / 180;
/** Vertical field of view [degrees]. */
export const FIELD = 30;
const ROUND_ALL = 1.2;
const ROUND_ONE = 2.5;
const FILLED = 0.86;
const ALONE = 0.5;
/** An object this many times larger than any that moves belongs to the surroundings, as a floor does. */
const LARGE = 12;
/** A view this many times wider than the smallest moving object shows it too small; farther things are left out. */
const FAR = 60;
/** Half edge of a mark, as a share of the largest distance, and if there is none [m]. */
const MARK = 0.035;
const ALONE_M = 0.05;

export interface Camera {
  /** The point to look at [m]. */
  centre: Triple;
  /** From there to the camera [m]. */
  distance: number;
  /** Diagonal of what is shown [m]. */
  extent: number;
  /** Lowest height of the things [m]. */
  floor: number;
}

type Points = Triple[];

/** The direction in which the camera looks at first, as a unit vector. */
export const FORWARD: Triple = [
  Math.cos(AZIMUTH) * Math.cos(ELEVATION),
  Math.sin(AZIMUTH) * Math.cos(ELEVATION),
  Math.sin(ELEVATION),
];
const RIGHT: Triple = [Math.sin(AZIMUTH), -Math.cos(AZIMUTH), 0];
const UP: Triple = [
  RIGHT[1] * FORWARD[2] - RIGHT[2] * FORWARD[1],
  RIGHT[2] * FORWARD[0] - RIGHT[0] * FORWARD[2],
  RIGHT[0] * FORWARD[1] - RIGHT[1] * FORWARD[0],
];

/**
 * The camera that shows a drawing at some moments.
 *
 * @param drawing - What is drawn.
 * @param moments - The poses at each of them; at least one.
 * @param aspect - Width of the picture over its height.
 * @param marks - Further places to show [m].
 */
export function cameraFor(drawing: Drawing, moments: Poses[], aspect: number, marks: Points = []): Camera {
  const subject = subjectOf(drawing, moments, marks);
  const [first = [0, 0, 0] as Triple] = subject.things;
  // Nothing, or a single point, such as the fixed end of a spring whose object was not read yet, has no size.
  if (subject.things.length === 0 || sizeOf(subject.things) === 0) {
    return { centre: first, distance: 4, extent: 2, floor: first[2] };
  }
  const low = bound(subject.things, Math.min);
  const high = bound(subject.things, Math.max);
  const reach = Math.min(ROUND_ALL * Math.max(...minus(high, low)), ROUND_ONE * subject.size);
  const near = subject.fixtures
    .map((corners) => corners.map((corner) => clipped(corner, low, high, reach)))
    .filter((corners) => minus(bound(corners, Math.max), bound(corners, Math.min)).every((edge) => edge > 0));
  const points = [...subject.things, ...near.flat()];
  const tall = Math.tan((FIELD * Math.PI) / 360) * (points.length > 8 ? FILLED : ALONE);
  const [bottom, top] = [bound(points, Math.min), bound(points, Math.max)];
  return {
    ...fitted(points, middle(bottom, top), [tall * aspect, tall]),
    extent: norm(minus(top, bottom)),
    floor: low[2],
  };
}

/** Corners of what `cameraFor` shows whole, in the world. */
export function thingsOf(drawing: Drawing, moments: Poses[], marks: Points = []): Points {
  return subjectOf(drawing, moments, marks).things;
}

function fitted(points: Points, start: Triple, limits: [number, number]): { centre: Triple; distance: number } {
  let centre = start;
  let distance = 0;
  for (let round = 0; round < 8; round += 1) {
    const seen = points
      .map((point) => minus(point, centre))
      .map((at) => [dot(at, RIGHT), dot(at, UP), dot(at, FORWARD)] as Triple);
    distance = Math.max(
      ...seen.map(([x, y, along]) => Math.max(Math.abs(x) / limits[0], Math.abs(y) / limits[1]) - along),
    );
    const place = seen.map(([x, y, along]) => [x / (distance + along), y / (distance + along), 0] as Triple);
    // Perspective moves the middle of the box away from the middle of the picture; this moves it back.
    const [dx, dy] = middle(bound(place, Math.min), bound(place, Math.max));
    centre = centre.map((value, axis) => value + distance * (dx * RIGHT[axis]! + dy * UP[axis]!)) as Triple;
  }
  return { centre, distance };
}

interface Subject {
  things: Points;
  fixtures: Points[];
  size: number;
}

function subjectOf(drawing: Drawing, moments: Poses[], marks: Points): Subject {
  const fixed = (drawing.schematic ?? []).map((course) => course.points.filter((point) => typeof point !== "string"));
  const boxes = drawing.bodies.flatMap((body) => moments.flatMap((poses) => boxesOf(body, poses[body.id])));
  boxes.push(...marksOf(marks, [...boxes.flatMap((box) => (box.endless ? [] : box.corners)), ...fixed.flat()]));
  const bounded = boxes.some((box) => !box.endless) ? boxes.filter((box) => !box.endless) : boxes;
  const named = bounded.some((box) => box.body.object) ? bounded.filter((box) => box.body.object) : bounded;
  const moving = named.filter((box) => box.body.movable).map((box) => sizeOf(box.corners));
  const largest = moving.length > 0 ? LARGE * Math.max(...moving) : Infinity;
  const farthest = moving.length > 0 ? FAR * Math.min(...moving) : Infinity;
  const parts = named.filter((box) => sizeOf(box.corners) <= largest).map((box) => box.corners);
  parts.push(...fixed.filter((points) => points.length > 0));
  let things = parts.shift() ?? [];
  while (parts.length > 0) {
    const grown = parts.map((part) => [...things, ...part]);
    const nearest = grown.reduce((best, one, index) => (sizeOf(one) < sizeOf(grown[best]!) ? index : best), 0);
    if (sizeOf(grown[nearest]!) > farthest) break;
    things = grown[nearest]!;
    parts.splice(nearest, 1);
  }
  const around = bounded
    .filter((box) => !named.includes(box) || sizeOf(box.corners) > largest)
    .map((box) => box.corners);
  return { things, fixtures: around, size: moving.length > 0 ? Math.max(...moving) : sizeOf(things) };
}

/** Boxes around marks, of a size that depends only on the distances in the picture. */
function marksOf(marks: Points, others: Points): Box[] {
  if (marks.length === 0) return [];
  const half = MARK * sizeOf([...marks, ...others]) || ALONE_M;
  const body: Body = { id: "", object: true, movable: true, parts: [] };
  const part: Part = { shape: "box", size: [half, half, half], pos: [0, 0, 0], quat: [1, 0, 0, 0], rgba: [0, 0, 0, 0] };
  return marks.map((mark) => ({ body, corners: cornersOf(part, [...mark, 1, 0, 0, 0]), endless: false }));
}

interface Box {
  body: Body;
  corners: Points;
  endless: boolean;
}

/** The middle of the upper side of the box around a body, in the world. */
export function topOf(body: Body, pose: Pose | undefined): Triple {
  const corners = body.parts.flatMap((part) => cornersOf(part, pose));
  const [low, high] = [bound(corners, Math.min), bound(corners, Math.max)];
  return [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, high[2]];
}

function boxesOf(body: Body, pose: Pose | undefined): Box[] {
  return body.parts.map((part) => ({ body, corners: cornersOf(part, pose), endless: part.shape === "plane" }));
}

/** Half edge lengths of the box around a part, in its own axes. */
function halfEdges(part: Part): Triple {
  const [a, b, c] = part.size;
  switch (part.shape) {
    case "sphere":
      return [a, a, a];
    case "capsule":
      return [a, a, a + b];
    case "cylinder":
      return [a, a, b];
    case "plane":
      return [a || 1, b || 1, 0];
    default:
      return [a, b, c];
  }
}

function cornersOf(part: Part, pose: Pose | undefined): Points {
  const half = halfEdges(part);
  const signs = [-1, 1].flatMap((x) => [-1, 1].flatMap((y) => [-1, 1].map((z) => [x, y, z] as Triple)));
  return signs.map((sign) => placed(part, pose, sign.map((value, axis) => value * half[axis]!) as Triple));
}

/** A point of a part, in the world. */
function placed(part: Part, pose: Pose | undefined, point: Triple): Triple {
  const inBody = plus(part.pos, turned(part.quat, point));
  return pose ? plus(pose.slice(0, 3) as Triple, turned(pose.slice(3) as Quaternion, inBody)) : inBody;
}

/** A vector turned by a unit quaternion. */
export function turned([w, x, y, z]: Quaternion, [a, b, c]: Triple): Triple {
  const [p, q, r] = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [a + w * p + y * r - z * q, b + w * q + z * p - x * r, c + w * r + x * q - y * p];
}

/** Points whose convex hull is the outline of a part, in the world. */
export function outlineOf(part: Part, pose: Pose | undefined): Points {
  const [a, b] = part.size;
  if (part.shape === "box" || part.shape === "plane") return cornersOf(part, pose);
  const half = halfEdges(part);
  const rings = part.shape === "cylinder" ? [-b, b].map((z) => ({ z, share: 1 })) : ROUND_RINGS;
  const points = rings.flatMap(({ z, share }) =>
    ANGLES.map((angle): Triple => {
      const [x, y] = [Math.cos(angle) * share, Math.sin(angle) * share];
      if (part.shape === "cylinder") return [x * a, y * a, z];
      if (part.shape === "capsule") return [x * a, y * a, z * a + Math.sign(z) * b];
      return [x * half[0], y * half[1], z * half[2]];
    }),
  );
  return points.map((point) => placed(part, pose, point));
}

const ANGLES = Array.from({ length: 24 }, (_, index) => (index * Math.PI) / 12);
const ROUND_RINGS = Array.from({ length: 12 }, (_, index) => {
  const height = ((index + 0.5) / 12) * Math.PI;
  return { z: -Math.cos(height), share: Math.sin(height) };
});

/** Where a camera sees a point: to the right and up, in heights of the picture from its middle, and how far away [m]. */
export function seenFrom({ centre, distance }: Camera, point: Triple): Triple {
  const at = minus(point, centre);
  const depth = dot(at, FORWARD) + distance;
  const scale = 2 * Math.tan((FIELD * Math.PI) / 360) * depth;
  return [dot(at, RIGHT) / scale, dot(at, UP) / scale, depth];
}

function clipped(point: Triple, low: Triple, high: Triple, reach: number): Triple {
  return point.map((value, axis) => Math.min(Math.max(value, low[axis]! - reach), high[axis]! + reach)) as Triple;
}

function bound(points: Points, pick: (...values: number[]) => number): Triple {
  return [0, 1, 2].map((axis) => pick(...points.map((point) => point[axis]!))) as Triple;
}

function sizeOf(points: Points): number {
  return Math.max(...minus(bound(points, Math.max), bound(points, Math.min)));
}

function plus(a: Triple, b: Triple): Triple {
  return [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
}

function minus(a: Triple, b: Triple): Triple {
  return [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
}

function middle(a: Triple, b: Triple): Triple {
  return [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2, (a[2] + b[2]) / 2];
}

function dot(a: Triple, b: Triple): number {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

function norm(a: Triple): number {
  return Math.hypot(...a);
}
