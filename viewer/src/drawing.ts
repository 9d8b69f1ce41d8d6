/**
 * The data that a view is drawn from, as the laboratory sends it: SI units, z up, quaternions with w first.
 * `physment_mcp/serving/views.py` writes it.
 */

export type Triple = [number, number, number];
export type Quaternion = [number, number, number, number];

export type Shape = "sphere" | "box" | "capsule" | "cylinder" | "ellipsoid" | "plane";

/** A shape in the frame of its body. */
export interface Part {
  shape: Shape;
  /** As MuJoCo has it: radius and half lengths [m]; 0 for the endless directions of a plane. */
  size: Triple;
  pos: Triple;
  quat: Quaternion;
  rgba: [number, number, number, number];
}

export interface Body {
  id: string;
  /** Whether tools know it by this id. */
  object: boolean;
  /** Whether any joint lets it move. */
  movable?: boolean;
  parts: Part[];
}

/** A part of the task that is no body of the model; its points are places in the world [m] and middles of objects. */
export interface Course {
  kind: "cord" | "spring" | "rod" | "rail" | "pulley";
  points: (string | Triple)[];
}

export interface Drawing {
  bodies: Body[];
  schematic?: Course[];
  /** Object → its name in the table of the prompt. */
  names?: Record<string, string>;
}

/** What an object is called beside calls, which have ids: `glider (object_1)`. */
export function titleOf({ names }: Drawing, id: string): string {
  const name = names && Object.hasOwn(names, id) ? names[id] : id;
  return name !== id ? `${name} (${id})` : id;
}

/** Which bodies are drawn; the camera may stay while they are the same. */
export function bodyIds(drawing: Drawing): string {
  return drawing.bodies.map((body) => body.id).join(" ");
}

/** Position [m] and orientation: x, y, z, qw, qx, qy, qz. */
export type Pose = [number, number, number, number, number, number, number];

/** Body → pose. A body without one has its parts in the world frame. */
export type Poses = Record<string, Pose>;

/** What a call returned last of the place of an object. */
export interface Reading {
  position: Triple;
  /** About its joint [rad]. */
  angle?: number;
  /** Simulation clock [s]. */
  time: number;
}

/** Object → its last reading. */
export type Readings = Record<string, Reading>;

export interface Motion {
  /** Instants [s], ascending. */
  times: number[];
  /** Body → its pose at each instant. */
  poses: Record<string, Pose[]>;
}

/** What may be seen at one moment, and how it moved until then. */
export interface View {
  /** Simulation clock [s]. */
  time: number;
  drawing: Drawing;
  poses: Poses;
  motion?: Motion;
  /** Last readings of objects that are not drawn. */
  read?: Readings;
}

/** Key of the view in `_meta` of a result. */
export const VIEW = "physment/view";

/** The view in `_meta` of a result; null if there is none. */
export function viewIn(meta: unknown): View | null {
  if (typeof meta !== "object" || meta === null || !(VIEW in meta)) return null;
  return asView(meta[VIEW]);
}

/** A view, if a value has the form of one; null otherwise. */
export function asView(value: unknown): View | null {
  const found = value as Partial<View> | null;
  const whole =
    typeof found === "object" &&
    found !== null &&
    typeof found.time === "number" &&
    Array.isArray(found.drawing?.bodies) &&
    typeof found.poses === "object";
  return whole ? (found as View) : null;
}
