/** What surrounds the bodies: light, shadow, and a grid on the ground. */

import { Color, DirectionalLight, GridHelper, Group, HemisphereLight, type Scene, Vector3 } from "three";

import type { Drawing } from "./drawing.js";
import { type Camera, turned } from "./framing.js";
import { roundLength } from "./ruler.js";

/** Lines of the grid in each direction. */
const LINES = 40;
const SHADOW_PX = 1024;

/** Light and grid of a scene; `fit` places them for what is seen. */
export class Stage {
  /** Distance of two lines of the grid [m]. */
  step = 1;
  private readonly sky = new HemisphereLight(0xffffff, 0x8a8f98, 1.6);
  private readonly sun = new DirectionalLight(0xffffff, 2.2);
  private readonly grid = new Group();

  constructor(scene: Scene) {
    this.sky.position.set(0, 0, 1);
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.set(SHADOW_PX, SHADOW_PX);
    this.sun.shadow.radius = 3;
    scene.add(this.sky, this.sun, this.sun.target, this.grid);
  }

  /** Place light and grid for what a camera shows of a drawing. */
  fit(drawing: Drawing, { centre, extent, floor }: Camera, dark: boolean): void {
    const middle = new Vector3(...centre);
    this.sun.target.position.copy(middle);
    this.sun.position.copy(middle).add(new Vector3(-0.45, -0.7, 1.3).multiplyScalar(extent * 2));
    const box = this.sun.shadow.camera;
    box.left = box.bottom = -extent;
    box.right = box.top = extent;
    box.near = extent * 0.1;
    box.far = extent * 6;
    box.updateProjectionMatrix();
    this.sun.shadow.bias = -0.0006;
    this.sun.shadow.normalBias = extent * 0.002;
    this.step = roundLength(extent / 6);
    this.layGrid(centre, groundOf(drawing) ?? Math.floor(floor / this.step + 1e-6) * this.step, dark);
  }

  /** Free what the graphics card holds. */
  dispose(): void {
    this.clear();
    this.sun.dispose();
  }

  private layGrid([x, y]: [number, number, number], height: number, dark: boolean): void {
    this.clear();
    const [axis, line] = dark ? [0x8791a1, 0x46505e] : [0x7b8494, 0xb4bcc8];
    const lines = new GridHelper(LINES * this.step, LINES, new Color(axis), new Color(line));
    lines.rotation.x = Math.PI / 2;
    lines.material.transparent = true;
    lines.material.opacity = 0.55;
    lines.material.depthWrite = false;
    // On whole steps, so that the lines have round coordinates.
    lines.position.set(Math.round(x / this.step) * this.step, Math.round(y / this.step) * this.step, height);
    this.grid.add(lines);
  }

  private clear(): void {
    for (const item of [...this.grid.children]) {
      this.grid.remove(item);
      (item as GridHelper).dispose();
    }
  }
}

/** Height of the highest level plane of a drawing [m]; null if it has none. */
function groundOf(drawing: Drawing): number | null {
  const heights = drawing.bodies
    .filter((body) => !body.movable)
    .flatMap((body) => body.parts)
    .filter((part) => part.shape === "plane" && turned(part.quat, [0, 0, 1])[2] > 0.9999)
    .map((part) => part.pos[2]);
  return heights.length > 0 ? Math.max(...heights) : null;
}
