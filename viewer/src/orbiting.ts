/** Moves a camera round its target by steps, for the keyboard. */

import type { PerspectiveCamera } from "three";
import type { OrbitControls } from "three/addons/controls/OrbitControls.js";

const TURN = Math.PI / 24;

/** Move a camera as a key asks for; false if the key means nothing here. */
export function orbitBy(key: string, camera: PerspectiveCamera, controls: OrbitControls): boolean {
  const turn = { ArrowLeft: [-TURN, 0], ArrowRight: [TURN, 0], ArrowUp: [0, -TURN], ArrowDown: [0, TURN] }[key];
  const zoom = { "+": 0.85, "=": 0.85, "-": 1 / 0.85 }[key];
  if (!turn && !zoom) return false;
  const { target, minDistance, maxDistance } = controls;
  const from = camera.position.clone().sub(target);
  const distance = Math.min(Math.max(from.length() * (zoom ?? 1), minDistance), maxDistance);
  const polar = Math.min(Math.max(Math.acos(from.z / from.length()) + (turn?.[1] ?? 0), 0.02), Math.PI - 0.02);
  const azimuth = Math.atan2(from.y, from.x) + (turn?.[0] ?? 0);
  from.set(Math.sin(polar) * Math.cos(azimuth), Math.sin(polar) * Math.sin(azimuth), Math.cos(polar));
  camera.position.copy(target).addScaledVector(from, distance);
  controls.update();
  return true;
}
