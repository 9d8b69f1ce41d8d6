/** A drawing as outlines in SVG, from the same camera: for browsers that cannot draw in three dimensions. */

import { type Body, bodyIds, type Drawing, type Part, type Pose, type Poses, type Readings, titleOf, type Triple } from "./drawing.js";
import { type Camera, cameraFor, outlineOf, seenFrom, thingsOf } from "./framing.js";
import type { LabViewOptions, OnHover } from "./lab_view.js";
import { Sketch, unseenOf } from "./sketch.js";
import { readingInWords } from "./words.js";

const SVG = "http://www.w3.org/2000/svg";
const [WIDTH, HEIGHT] = [640, 420];

/** Draws what `LabView` draws, without light and from one side; its methods are those of `LabView`. */
export class Schematic {
  readonly firstPictureMs = 0;
  private readonly picture = document.createElementNS(SVG, "svg");
  private drawing: Drawing = { bodies: [] };
  private poses: Poses = {};
  private read: Readings = {};
  private readonly sketch = new Sketch();
  private camera: Camera | null = null;
  private hover: OnHover | null = null;
  private marked: string | null = null;

  constructor(
    container: HTMLElement,
    private readonly options: LabViewOptions = {},
  ) {
    this.picture.setAttribute("viewBox", `0 0 ${WIDTH} ${HEIGHT}`);
    this.picture.setAttribute("class", "lab-schematic");
    container.append(this.picture);
    const point = (event: PointerEvent) =>
      this.hover?.((event.target as Element).getAttribute("data-id"), event.offsetX, event.offsetY);
    for (const event of ["pointermove", "pointerup"] as const) this.picture.addEventListener(event, point);
  }

  setDrawing(drawing: Drawing, steady = false): void {
    const same = bodyIds(drawing) === bodyIds(this.drawing);
    this.drawing = drawing;
    if (!same && !steady) this.camera = null;
  }

  show(poses: Poses): void {
    this.poses = poses;
    if (this.camera) this.draw(this.camera);
    else this.frame([poses]);
  }

  setRead(read: Readings): void {
    this.read = read;
    if (this.camera) this.draw(this.camera);
  }

  frame(moments: Poses[], marks: Triple[] = []): void {
    this.camera = cameraFor(this.drawing, moments, WIDTH / HEIGHT, marks);
    this.draw(this.camera);
  }

  follow(moments: Poses[], marks: Triple[] = []): void {
    const { camera } = this;
    const isInside = (point: Triple) => {
      const [x, y, depth] = seenFrom(camera!, point);
      return Math.abs(x) * HEIGHT < WIDTH / 2 && Math.abs(y) < 0.5 && depth > 0;
    };
    if (!camera || !thingsOf(this.drawing, moments, marks).every(isInside)) this.frame(moments, marks);
    else this.draw(camera);
  }

  resize(): void {
    // The picture scales by itself.
  }

  setDark(_dark: boolean): void {
    // The outlines have the colour of the text.
  }

  onHover(callback: OnHover): void {
    this.hover = callback;
  }

  mark(id: string | null): void {
    this.marked = id;
    if (this.camera) this.draw(this.camera);
  }

  dispose(): void {
    this.picture.remove();
  }

  private draw(camera: Camera): void {
    const shapes = this.drawing.bodies
      .flatMap((body) => body.parts.map((part) => this.shapeOf(camera, body, part)))
      .filter((shape) => shape !== null)
      .sort((one, other) => other.depth - one.depth);
    this.sketch.draw((point) => placed(camera, point), this.drawing, this.poses, this.read);
    const named = [...this.names(camera), ...this.unseen(camera)];
    this.picture.replaceChildren(...shapes.map((shape) => shape.element), this.sketch.element, ...named);
  }

  private shapeOf(camera: Camera, body: Body, part: Part): { element: SVGElement; depth: number } | null {
    const points = outlineOf(part, this.poses[body.id]).map((point) => seenFrom(camera, point));
    if (points.some(([, , depth]) => depth <= 0)) return null;
    const element = document.createElementNS(SVG, "polygon");
    const hull = hullOf(points.map(([x, y]) => [WIDTH / 2 + x * HEIGHT, HEIGHT / 2 - y * HEIGHT]));
    element.setAttribute("points", hull.map((point) => point.join(",")).join(" "));
    const [red, green, blue, opacity] = part.rgba;
    element.setAttribute("fill", `rgb(${[red, green, blue].map((share) => Math.round(share * 255)).join(" ")})`);
    element.setAttribute("fill-opacity", `${0.75 * opacity}`);
    if (body.object) element.setAttribute("data-id", body.id);
    if (body.id === this.marked) element.setAttribute("class", "lab-marked-shape");
    return { element, depth: points.reduce((sum, [, , depth]) => sum + depth, 0) / points.length };
  }

  private nameOf(id: string): string {
    return this.options.names?.(id) ?? titleOf(this.drawing, id);
  }

  private names(camera: Camera): SVGElement[] {
    return this.drawing.bodies
      .filter((body) => body.object && body.parts.length > 0)
      .map((body) => textAt(placed(camera, originOf(body, this.poses[body.id])), this.nameOf(body.id)));
  }

  private unseen(camera: Camera): SVGElement[] {
    return unseenOf(this.drawing, this.read).map(([id, read]) => {
      const [x, y] = placed(camera, read.position);
      return textAt([Math.min(Math.max(x, WIDTH / 4), (3 * WIDTH) / 4), y - 14], `${this.nameOf(id)}, ${readingInWords(read)}`);
    });
  }
}

function placed(camera: Camera, point: Triple): Flat {
  const [x, y] = seenFrom(camera, point);
  return [WIDTH / 2 + x * HEIGHT, HEIGHT / 2 - y * HEIGHT];
}

function textAt([x, y]: Flat, words: string): SVGElement {
  const text = document.createElementNS(SVG, "text");
  text.setAttribute("x", `${x}`);
  text.setAttribute("y", `${y}`);
  text.textContent = words;
  return text;
}

function originOf(body: Body, pose: Pose | undefined): Triple {
  return (pose?.slice(0, 3) ?? body.parts[0]?.pos ?? [0, 0, 0]) as Triple;
}

type Flat = [number, number];

/** The convex hull of points, in order round it. */
function hullOf(points: Flat[]): Flat[] {
  const sorted = [...points].sort((one, other) => one[0] - other[0] || one[1] - other[1]);
  const half = (from: Flat[]): Flat[] => {
    const chain: Flat[] = [];
    for (const point of from) {
      while (chain.length > 1 && turn(chain.at(-2)!, chain.at(-1)!, point) <= 0) chain.pop();
      chain.push(point);
    }
    return chain.slice(0, -1);
  };
  return [...half(sorted), ...half(sorted.reverse())];
}

/** Positive if three points turn to the left. */
function turn([ax, ay]: Flat, [bx, by]: Flat, [cx, cy]: Flat): number {
  return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
}
