/** Plain words for tools, their arguments, what they return, and objects; the names of the wire stand small beside them. */

import { element } from "./markup.js";
import { shortened } from "./readings.js";
import type { Call } from "./talk.js";

/** An object that tools know, and the name that the task gives it. */
export interface Known {
  id: string;
  name: string;
}

/** Object id → what a person calls it. */
export type Names = (id: string) => string;

const TOOLS: Record<string, string> = {
  step: "let time pass",
  get_position: "position",
  get_velocity: "velocity",
  get_acceleration: "acceleration",
  get_displacement: "displacement",
  get_parameters: "mass, size and shape",
  get_torque: "applied torque",
  get_kinetic_energy: "kinetic energy",
  get_potential_energy: "potential energy",
  get_rotational_energy: "energy of rotation",
  get_momentum: "momentum",
  get_angular_momentum: "angular momentum",
  get_center_of_mass: "centre of mass of all",
  compute_force: "net force",
  detect_collision: "contact of two objects",
  quat_to_rot_matrix: "quaternion to matrix",
  move_object: "put at a place",
  change_position: "shift",
  set_velocity: "give a velocity",
  apply_force: "apply a force",
  apply_torque: "apply a torque",
  create_objects: "create a sphere",
  delete_objects: "remove",
  find_objects: "look for hidden objects",
  attach_objects: "join two objects",
  answer: "answer",
};

/** Argument → its name in words, and its unit. */
const ARGUMENTS: Record<string, [string, string?]> = {
  duration: ["duration", "s"],
  object_id: ["object"],
  obj1_id: ["first object"],
  obj2_id: ["second object"],
  object1_id: ["first object"],
  object2_id: ["second object"],
  x: ["x", "m"],
  y: ["y", "m"],
  z: ["z", "m"],
  dx: ["along x", "m"],
  dy: ["along y", "m"],
  dz: ["along z", "m"],
  in_world_frame: ["along the world axes"],
  velocity_vector: ["velocity", "m/s"],
  force_vector: ["force", "N"],
  torque_vector: ["torque", "N·m"],
  mass: ["mass", "kg"],
  gravity: ["gravity", "m/s²"],
  elastic_response: ["bounce elastically"],
  q: ["quaternion"],
  pos: ["centre", "m"],
  density: ["density", "kg/m³"],
  radius: ["radius", "m"],
  rgba: ["colour"],
};

const FIELDS: Record<string, string> = {
  lab_time_left: "laboratory time left",
  center_of_mass: "centre of mass",
  in_contact: "touching",
};

function spaced(name: string): string {
  return name.replaceAll("_", " ");
}

/** What a tool does or reads. */
export function toolInWords(name: string): string {
  return TOOLS[name] ?? spaced(name);
}

/** What an argument of a tool means, in a word or two. */
export function argumentInWords(name: string): string {
  return ARGUMENTS[name]?.[0] ?? spaced(name);
}

/** What a field of a result is. */
export function fieldInWords(name: string): string {
  return FIELDS[name] ?? spaced(name);
}

/** What people call objects: by the name in the task where it is the only one of that name, and else by name and id. */
export function namesOf(objects: Known[]): Names {
  const byId = new Map(objects.map(({ id, name }) => [id, name]));
  return (id) => {
    const name = byId.get(id);
    if (!name || name === id) return id;
    return objects.filter((one) => one.name === name).length > 1 ? `${name} (${id})` : name;
  };
}

/** The name of a tool or an argument on the wire, small; nothing where the words are the same. */
export function wireName(name: string, words: string): (Node | string)[] {
  return name === words ? [] : [" ", element("small", { class: "play-wire" }, name)];
}

/** A call for a person, such as `apply a force · ball · [0, 0, 5] N`. */
export function callInWords(call: Call, names: Names): string {
  const given = Object.entries(call.arguments).map(([name, value]) => {
    if (/^obj(ect)?\d?_id$/.test(name)) return names(typeof value === "number" ? `object_${value}` : `${value as string}`);
    if (typeof value === "boolean") return value ? argumentInWords(name) : `not ${argumentInWords(name)}`;
    return [shortened(value), ARGUMENTS[name]?.[1] ?? ""].filter(Boolean).join(" ");
  });
  return [toolInWords(call.tool), ...given].join(" · ");
}

/** A call in words, with the name of its tool. */
export function shownCall(call: Call, names: Names): (Node | string)[] {
  return [callInWords(call, names), ...wireName(call.tool, toolInWords(call.tool))];
}
