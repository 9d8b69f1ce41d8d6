/**
 * A force that a person draws by dragging an object: the arrow is the force, a dashed ring its limit. It is drawn in the
 * plane of two world axes that faces the camera, so that one component is 0. It sends nothing, and needs only what is
 * drawn already; a form offers the same by keyboard.
 */

import { type PerspectiveCamera, Plane, Raycaster, Vector2, Vector3 } from "three";

import type { Triple } from "./drawing.js";

const SVG = "http://www.w3.org/2000/svg";
/** Length of the arrow of the largest force, as a share of the shorter side of the picture. */
const REACH = 0.36;
/** Force of an arrow of that length where no limit is stated [N]. */
const USUAL_FORCE = 10;
/** Shorter drags are clicks [px]. */
const LEAST_PX = 8;
/** An arrow that is this near to an axis lies on it: share of its length. */
const SNAP = 0.08;
const HEAD_PX = 9;
const AXES = [new Vector3(1, 0, 0), new Vector3(0, 1, 0), new Vector3(0, 0, 1)];

export interface ForceRules {
  /** Whether a force may be set on an object now. */
  allows(id: string): boolean;
  /** Largest force [N]; null without a limit. */
  limit(): number | null;
  /** Take over a force that was drawn [N]. */
  drawn(id: string, force: Triple): void;
}

/** The picture in which a force is drawn. */
export interface Canvas {
  element: HTMLElement;
  camera: PerspectiveCamera;
  /** Lines over the picture, in pixels. */
  layer: SVGElement;
  /** The object at a place of the picture [px]. */
  hit(x: number, y: number): string | null;
  /** The middle of an object [m]. */
  middle(id: string): Vector3 | null;
  /** Where a point is in the picture [px]; null if it is out of sight. */
  seen(point: Triple): [number, number] | null;
  /** Keep the camera where it is, or let it go. */
  hold(held: boolean): void;
}

interface Drag {
  id: string;
  at: Vector3;
  normal: Vector3;
  /** Length of the arrow of the force `full` [m]. */
  reach: number;
  full: number;
  from: [number, number];
  force: Triple | null;
}

export class ForceDrag {
  /** null while no forces may be drawn. */
  rules: ForceRules | null = null;
  private drag: Drag | null = null;
  private readonly group = document.createElementNS(SVG, "g");

  constructor(
    private readonly canvas: Canvas,
    signal: AbortSignal,
  ) {
    canvas.layer.append(this.group);
    const { element } = canvas;
    // In the capturing phase: before the controls of the camera take the pointer.
    element.addEventListener("pointerdown", (event) => this.begin(event), { signal, capture: true });
    // A finger that draws a force does not scroll the page.
    element.addEventListener("touchstart", (event) => this.drag && event.preventDefault(), { signal, passive: false });
    element.addEventListener("pointermove", (event) => this.move(event), { signal });
    element.addEventListener("pointerup", () => this.finish(true), { signal });
    element.addEventListener("pointercancel", () => this.finish(false), { signal });
    addEventListener("keydown", ({ key }) => key === "Escape" && this.finish(false), { signal });
  }

  /** Whether a force is being drawn. */
  get isBusy(): boolean {
    return this.drag !== null;
  }

  private begin({ offsetX: x, offsetY: y, button, pointerId }: PointerEvent): void {
    const id = button === 0 && this.rules ? this.canvas.hit(x, y) : null;
    const at = id === null ? null : this.canvas.middle(id);
    if (id === null || !at || !this.rules?.allows(id)) return;
    const { camera, element } = this.canvas;
    const distance = camera.position.distanceTo(at);
    const perPixel = (2 * distance * Math.tan((camera.fov * Math.PI) / 360)) / element.clientHeight;
    const reach = REACH * Math.min(element.clientWidth, element.clientHeight) * perPixel;
    this.drag = { id, at, normal: facing(camera), reach, full: this.rules.limit() ?? USUAL_FORCE, from: [x, y], force: null };
    this.canvas.hold(true);
    element.setPointerCapture(pointerId);
  }

  private move({ offsetX: x, offsetY: y }: PointerEvent): void {
    const { drag } = this;
    if (!drag) return;
    const isLong = Math.hypot(x - drag.from[0], y - drag.from[1]) >= LEAST_PX;
    drag.force = isLong ? this.forceAt(drag, x, y) : null;
    this.draw(drag);
  }

  /** The force of an arrow from the middle of the object to the pointer. */
  private forceAt({ at, normal, reach, full }: Drag, x: number, y: number): Triple | null {
    const { camera, element } = this.canvas;
    const ray = new Raycaster();
    ray.setFromCamera(new Vector2((x / element.clientWidth) * 2 - 1, 1 - (y / element.clientHeight) * 2), camera);
    const met = ray.ray.intersectPlane(new Plane().setFromNormalAndCoplanarPoint(normal, at), new Vector3());
    const drawn = met?.sub(at).multiplyScalar(full / reach);
    if (!drawn) return null;
    const least = SNAP * drawn.length();
    const arrow = new Vector3(...drawn.toArray().map((part) => (Math.abs(part) < least ? 0 : part)));
    arrow.clampLength(0, this.rules?.limit() ?? Infinity);
    // Towards 0, so that rounding does not lead beyond the limit.
    const unit = 10 ** Math.floor(Math.log10(full) - 1.5);
    const round = (part: number) => Number((Math.trunc(part / unit + Math.sign(part) * 1e-6) * unit).toPrecision(6)) || 0;
    const [a, b, c] = arrow.toArray().map(round);
    return [a!, b!, c!];
  }

  private finish(isDone: boolean): void {
    const { drag } = this;
    if (!drag) return;
    this.drag = null;
    this.group.replaceChildren();
    this.canvas.hold(false);
    if (isDone && drag.force?.some((part) => part !== 0)) this.rules?.drawn(drag.id, drag.force);
  }

  private draw({ at, normal, reach, full, force }: Drag): void {
    const limit = this.rules?.limit() ?? null;
    const shapes = limit === null ? [] : this.ring(at, normal, reach, `limit ${limit} N`);
    if (force) {
      const tip = new Vector3(...force).multiplyScalar(reach / full).add(at);
      shapes.push(...this.arrow(at, tip, force));
    }
    this.group.replaceChildren(...shapes);
  }

  private ring(at: Vector3, normal: Vector3, reach: number, text: string): SVGElement[] {
    const [first, second] = AXES.filter((axis) => axis.dot(normal) === 0) as [Vector3, Vector3];
    const around = Array.from({ length: 48 }, (_, index) => {
      const angle = (index * Math.PI) / 24;
      return at.clone().addScaledVector(first, reach * Math.cos(angle)).addScaledVector(second, reach * Math.sin(angle));
    });
    const points = around.map((point) => this.canvas.seen(point.toArray())).filter((point) => point !== null);
    const top = points.reduce((one, other) => (other[1] < one[1] ? other : one), points[0] ?? [0, 0]);
    return [
      made("polygon", { class: "lab-force-limit", points: points.join(" ") }),
      label(text, top[0], Math.max(top[1] - 5, 12)),
    ];
  }

  private arrow(at: Vector3, to: Vector3, force: Triple): SVGElement[] {
    const [from, tip] = [this.canvas.seen(at.toArray()), this.canvas.seen(to.toArray())];
    if (!from || !tip) return [];
    const length = Math.hypot(tip[0] - from[0], tip[1] - from[1]) || 1;
    const [x, y] = [((tip[0] - from[0]) * HEAD_PX) / length, ((tip[1] - from[1]) * HEAD_PX) / length];
    const head = [tip, [tip[0] - x - y / 2, tip[1] - y + x / 2], [tip[0] - x + y / 2, tip[1] - y - x / 2]];
    const below = tip[1] > from[1] ? 16 : -8;
    return [
      made("line", { class: "lab-force", x1: from[0], y1: from[1], x2: tip[0] - x / 2, y2: tip[1] - y / 2 }),
      made("polygon", { class: "lab-force", points: head.join(" ") }),
      label(`[${force.join(", ")}] N`, tip[0], tip[1] + below),
    ];
  }
}

/** The world axis that is nearest to the direction in which a camera looks. */
function facing(camera: PerspectiveCamera): Vector3 {
  const ahead = camera.getWorldDirection(new Vector3());
  return AXES.reduce((one, other) => (Math.abs(other.dot(ahead)) > Math.abs(one.dot(ahead)) ? other : one));
}

function label(text: string, x: number, y: number): SVGElement {
  const shown = made("text", { class: "lab-force-text", x, y });
  shown.textContent = text;
  return shown;
}

function made(name: string, attributes: Record<string, string | number>): SVGElement {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, `${value}`);
  return element;
}
