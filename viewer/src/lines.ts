/** Lines through points in the world frame. */

import { BufferGeometry, Group, Line, LineBasicMaterial, Vector3 } from "three";

import type { Triple } from "./drawing.js";

/** A group of lines. */
export function linesOf(lines: Triple[][], dark: boolean): Group {
  const group = new Group();
  for (const points of lines) {
    const geometry = new BufferGeometry().setFromPoints(points.map((point) => new Vector3(...point)));
    group.add(new Line(geometry, new LineBasicMaterial({ color: dark ? 0xd5dae2 : 0x2d3440 })));
  }
  return group;
}
