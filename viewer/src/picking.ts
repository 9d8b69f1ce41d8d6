/** Which object is at a place of the picture, and where its middle is. */

import { Box3, type Group, type PerspectiveCamera, Raycaster, Vector2, Vector3 } from "three";

import type { Reading, Readings, Triple } from "./drawing.js";

/** How near to a ring the pointer is at its object, in the picture [px]. */
const RING_PX = 16;
/** How near to the middle of an object, so that small ones can be hit by a finger [px]. */
const MIDDLE_PX = 12;

/** What can be pointed at. */
export interface Pickable {
  camera: PerspectiveCamera;
  world: Group;
  /** Ids of the objects that are drawn. */
  objects: string[];
  /** Objects of which the last reading is drawn. */
  unseen: [string, Reading][];
  container: HTMLElement;
  /** Where a point of the world is in the picture [px]; null if it is out of sight. */
  seen(point: Triple): [number, number] | null;
}

/**
 * The object at a place of the picture, or the one whose last reading is drawn there; null if there is none.
 *
 * @param place - The place in the picture [px].
 */
export function objectAt([x, y]: [number, number], view: Pickable): string | null {
  const { camera, world, container, objects, unseen } = view;
  const ray = new Raycaster();
  ray.setFromCamera(new Vector2((x / container.clientWidth) * 2 - 1, 1 - (y / container.clientHeight) * 2), camera);
  const hit = ray.intersectObjects(world.children, true)[0]?.object.parent?.name ?? "";
  if (objects.includes(hit)) return hit;
  const isNear = (point: Triple, most: number) => {
    const at = view.seen(point);
    return at !== null && Math.hypot(at[0] - x, at[1] - y) < most;
  };
  const ring = unseen.find(([, { position }]) => isNear(position, RING_PX));
  const small = (id: string) => isNear(middleOf(id, world, {})?.toArray() ?? [Infinity, 0, 0], MIDDLE_PX);
  return ring?.[0] ?? objects.find(small) ?? null;
}

/** The middle of an object that is drawn, or where it was read last; null if neither is known [m]. */
export function middleOf(id: string, world: Group, read: Readings): Vector3 | null {
  const group = world.children.find((one) => one.name === id);
  if (group) return new Box3().setFromObject(group).getCenter(new Vector3());
  return read[id] ? new Vector3(...read[id].position) : null;
}
