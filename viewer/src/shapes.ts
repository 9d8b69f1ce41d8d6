/** Parts of bodies as meshes. A mesh stands in the frame of its body. */

import {
  BoxGeometry,
  type BufferGeometry,
  CapsuleGeometry,
  Color,
  CylinderGeometry,
  DoubleSide,
  FrontSide,
  Group,
  Line,
  type Material,
  Mesh,
  MeshStandardMaterial,
  PlaneGeometry,
  SphereGeometry,
  SRGBColorSpace,
} from "three";

import type { Body, Part } from "./drawing.js";

/** Sides of a round shape: enough that its outline looks round in a window. */
const ROUND = 40;

/**
 * A body as a group with its id as name.
 *
 * @param body - What is drawn.
 * @param reach - Half edge of an endless plane [m].
 */
export function bodyGroup(body: Body, reach: number): Group {
  const group = new Group();
  group.name = body.id;
  for (const part of body.parts) group.add(meshOf(part, reach));
  return group;
}

function meshOf(part: Part, reach: number): Mesh {
  const mesh = new Mesh(geometryOf(part, reach), materialOf(part));
  const [w, x, y, z] = part.quat;
  mesh.position.set(...part.pos);
  mesh.quaternion.set(x, y, z, w);
  if (part.shape === "ellipsoid") mesh.scale.set(...part.size);
  mesh.castShadow = part.shape !== "plane" && part.rgba[3] > 0.5;
  mesh.receiveShadow = true;
  return mesh;
}

function geometryOf({ shape, size: [a, b, c] }: Part, reach: number): BufferGeometry {
  switch (shape) {
    case "sphere":
      return new SphereGeometry(a, ROUND, ROUND / 2);
    case "ellipsoid":
      return new SphereGeometry(1, ROUND, ROUND / 2);
    case "box":
      return new BoxGeometry(2 * a, 2 * b, 2 * c);
    // The axis of these two is z in MuJoCo and y in three.js.
    case "capsule":
      return new CapsuleGeometry(a, 2 * b, ROUND / 4, ROUND).rotateX(Math.PI / 2);
    case "cylinder":
      return new CylinderGeometry(a, a, 2 * b, ROUND).rotateX(Math.PI / 2);
    case "plane":
      return new PlaneGeometry(2 * (a || reach), 2 * (b || reach));
  }
}

function materialOf({ shape, rgba: [red, green, blue, opacity] }: Part): MeshStandardMaterial {
  return new MeshStandardMaterial({
    color: new Color().setRGB(red, green, blue, SRGBColorSpace),
    roughness: 0.65,
    metalness: 0,
    opacity,
    transparent: opacity < 1,
    depthWrite: opacity >= 1,
    side: shape === "plane" ? DoubleSide : FrontSide,
    // Things that lie on a plane must not flicker with it.
    polygonOffset: shape === "plane",
    polygonOffsetFactor: 1,
    polygonOffsetUnits: 1,
  });
}

/** Free what the graphics card holds of a group. */
export function dispose(group: Group): void {
  group.traverse((item) => {
    if (item instanceof Mesh || item instanceof Line) {
      (item.geometry as BufferGeometry).dispose();
      (item.material as Material).dispose();
    }
  });
}
