/** The laboratory as a three-dimensional picture: bodies at their poses, seen by a camera that a person can move. */

import { Group, PCFShadowMap, PerspectiveCamera, Scene, Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

import { Aim } from "./aim.js";
import { bodyIds, type Drawing, type Poses, type Readings, titleOf, type Triple } from "./drawing.js";
import { ForceDrag } from "./force_drag.js";
import { FIELD, topOf } from "./framing.js";
import { orbitBy } from "./orbiting.js";
import { Overlay } from "./overlay.js";
import { middleOf, objectAt } from "./picking.js";
import { metres } from "./ruler.js";
import { bodyGroup, dispose } from "./shapes.js";
import { unseenOf } from "./sketch.js";
import { Stage } from "./stage.js";
import { readingInWords } from "./words.js";

/** Half edge of an endless plane, in extents of what is seen. */
const ENDLESS = 12;
/** Objects that get labels; with more of them, only the one that is pointed at. */
const MOST_LABELS = 30;

export interface LabViewOptions {
  /** Light lines on dark ground, and the other way round by default. */
  dark?: boolean;
  /** Whether the camera moves at once, without gliding. */
  reducedMotion?: boolean;
  /** What the label of an object says, unless its name and id. */
  names?: (id: string) => string;
}

/** Is told the id of the object that is pointed at, and where the pointer is in the container [px]; null for none. */
export type OnHover = (id: string | null, x: number, y: number) => void;

/** A picture in a container, as large as the container; throws if `canDraw` is false. */
export class LabView {
  /** How long it took from the start of the constructor to the first picture [ms]; null before it. */
  firstPictureMs: number | null = null;
  private readonly started = performance.now();
  private readonly renderer: WebGLRenderer;
  private readonly scene = new Scene();
  private readonly camera = new PerspectiveCamera(FIELD, 1, 0.01, 100);
  private readonly controls: OrbitControls;
  private readonly aim: Aim;
  private readonly stage: Stage;
  private readonly overlay = new Overlay();
  private readonly world = new Group();
  private readonly watched: ResizeObserver;
  private readonly ends = new AbortController();
  private drawing: Drawing = { bodies: [] };
  private poses: Poses = {};
  private read: Readings = {};
  private hover: OnHover | null = null;
  /** Lets people draw forces, once it has rules. */
  readonly forces: ForceDrag;
  private pointed: string | null = null;
  private waiting = 0;
  private dark: boolean;

  constructor(
    private readonly container: HTMLElement,
    private readonly options: LabViewOptions = {},
  ) {
    this.dark = options.dark ?? false;
    this.renderer = new WebGLRenderer({ antialias: true, alpha: true });
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = PCFShadowMap;
    this.camera.up.set(0, 0, 1);
    this.stage = new Stage(this.scene);
    this.scene.add(this.world);
    container.classList.add("lab-view");
    if (container.tabIndex < 0) container.tabIndex = 0;
    container.append(this.renderer.domElement, this.overlay.element);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.aim = new Aim(this.camera, this.controls, container);
    this.controls.enableDamping = options.reducedMotion !== true;
    this.controls.addEventListener("change", () => this.draw());
    this.forces = new ForceDrag(
      {
        element: this.renderer.domElement,
        camera: this.camera,
        layer: this.overlay.forces,
        hit: (x, y) => this.hit(x, y),
        middle: (id) => middleOf(id, this.world, this.read),
        seen: (point) => this.seen(point),
        hold: (held) => (this.controls.enabled = !held),
      },
      this.ends.signal,
    );
    this.listen();
    this.watched = new ResizeObserver(() => this.resize());
    this.watched.observe(container);
  }

  /**
   * Replace what is drawn; the next `show` places it, and the camera if other things are seen than before.
   *
   * @param drawing - What is drawn from now on.
   * @param steady - Whether the camera stays in any case.
   */
  setDrawing(drawing: Drawing, steady = false): void {
    const same = bodyIds(drawing) === bodyIds(this.drawing);
    this.drawing = drawing;
    if (!same && !steady) this.aim.framed = null;
    this.rebuild();
    this.overlay.name(this.labels());
  }

  /** Put the bodies where they are. */
  show(poses: Poses): void {
    this.poses = poses;
    this.place();
    if (!this.aim.framed) this.frame([poses]);
    this.draw();
  }

  /** Draw objects that are not watched where they were read last. */
  setRead(read: Readings): void {
    this.read = read;
    this.overlay.name(this.labels());
    this.draw();
  }

  /** Place the camera so that the things are seen at all these moments, and these places [m]. */
  frame(moments: Poses[], marks: Triple[] = []): void {
    this.aim.frame({ drawing: this.drawing, moments, marks });
    this.surround();
  }

  /** The same, but the camera moves only if one of these would leave the picture, and then keeps its scale if it can. */
  follow(moments: Poses[], marks: Triple[] = []): void {
    this.aim.follow({ drawing: this.drawing, moments, marks });
    this.surround();
  }

  /** Fit the picture to the container; also called when the container changes its size. */
  resize(): void {
    const { clientWidth: width, clientHeight: height } = this.container;
    if (width === 0 || height === 0) return;
    this.renderer.setPixelRatio(Math.min(globalThis.devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  /** Choose colours for a dark or a light surrounding. */
  setDark(dark: boolean): void {
    this.dark = dark;
    this.surround();
  }

  /** Tell what the pointer is over. */
  onHover(callback: OnHover): void {
    this.hover = callback;
  }

  /** Emphasise an object, as when it is pointed at; null for none. */
  mark(id: string | null): void {
    this.pointed = id;
    if (this.objects().length > MOST_LABELS) this.overlay.name(this.labels());
    this.overlay.mark(id);
    this.draw();
  }

  /** Let go of the container and of what the graphics card holds. */
  dispose(): void {
    cancelAnimationFrame(this.waiting);
    this.ends.abort();
    this.watched.disconnect();
    this.controls.dispose();
    this.stage.dispose();
    for (const group of this.world.children) dispose(group as Group);
    this.renderer.dispose();
    this.renderer.domElement.remove();
    this.overlay.element.remove();
    this.container.classList.remove("lab-view");
  }

  /** Light, grid and endless planes for where the camera is put. */
  private surround(): void {
    if (this.aim.framed) this.stage.fit(this.drawing, this.aim.framed, this.dark);
    this.overlay.grid.textContent = `grid ${metres(this.stage.step)}`;
    this.rebuild();
    this.draw();
  }

  private objects(): string[] {
    return this.drawing.bodies.filter((body) => body.object).map((body) => body.id);
  }

  private labelled(): string[] {
    const objects = this.objects();
    return objects.length <= MOST_LABELS ? objects : objects.filter((id) => id === this.pointed);
  }

  private labels(): Map<string, string> {
    const nameOf = (id: string) => this.options.names?.(id) ?? titleOf(this.drawing, id);
    const unseen = unseenOf(this.drawing, this.read).map(([id, read]) => [id, `${nameOf(id)}\n${readingInWords(read)}`] as const);
    return new Map([...this.labelled().map((id) => [id, nameOf(id)] as const), ...unseen]);
  }

  private rebuild(): void {
    for (const group of [...this.world.children]) {
      this.world.remove(group);
      dispose(group as Group);
    }
    const reach = (this.aim.framed?.extent ?? 1) * ENDLESS;
    for (const body of this.drawing.bodies) this.world.add(bodyGroup(body, reach));
    this.place();
  }

  private place(): void {
    for (const group of this.world.children) {
      const pose = this.poses[group.name];
      if (!pose) continue;
      const [x, y, z, qw, qx, qy, qz] = pose;
      group.position.set(x, y, z);
      group.quaternion.set(qx, qy, qz, qw);
    }
  }

  private draw(): void {
    if (this.waiting) return;
    this.waiting = requestAnimationFrame(() => {
      this.waiting = 0;
      // Gliding asks for the next picture by the event `change`.
      this.controls.update();
      this.renderer.render(this.scene, this.camera);
      this.firstPictureMs ??= performance.now() - this.started;
      this.placeOverlay();
    });
  }

  private placeOverlay(): void {
    const { clientWidth: width, clientHeight: height } = this.container;
    const distance = this.camera.position.distanceTo(this.controls.target);
    const perPixel = (2 * distance * Math.tan((FIELD * Math.PI) / 360)) / Math.max(height, 1);
    const named = new Set(this.labelled());
    const labels = this.drawing.bodies
      .filter((body) => named.has(body.id))
      .map((body) => ({ id: body.id, at: new Vector3(...topOf(body, this.poses[body.id])) }));
    const unseen = unseenOf(this.drawing, this.read).map(([id, read]) => ({ id, at: new Vector3(...read.position) }));
    this.overlay.place(this.camera, [...labels, ...unseen], width, height, perPixel);
    this.overlay.sketch.draw((point) => this.seen(point), this.drawing, this.poses, this.read);
  }

  private seen(point: Triple): [number, number] | null {
    const { x, y, z } = new Vector3(...point).project(this.camera);
    const { clientWidth: width, clientHeight: height } = this.container;
    return Math.abs(z) > 1 ? null : [((x + 1) / 2) * width, ((1 - y) / 2) * height];
  }

  private listen(): void {
    const { signal } = this.ends;
    const canvas = this.renderer.domElement;
    const point = (event: PointerEvent) => this.point(event.offsetX, event.offsetY);
    for (const event of ["pointermove", "pointerup"] as const) canvas.addEventListener(event, point, { signal });
    // What a finger pointed at stays marked until the next tap.
    canvas.addEventListener("pointerleave", ({ pointerType }) => pointerType === "touch" || this.pointAt(null, 0, 0), { signal });
    // The wheel belongs to the page until somebody works with the picture.
    this.controls.enableZoom = false;
    const grasp = () => (this.controls.enableZoom = true);
    canvas.addEventListener("pointerdown", grasp, { signal, capture: true });
    this.container.addEventListener("focusin", grasp, { signal });
    this.container.addEventListener("focusout", () => (this.controls.enableZoom = false), { signal });
    this.container.addEventListener("keydown", (event) => this.press(event), { signal });
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault(), { signal });
    canvas.addEventListener("webglcontextrestored", () => this.draw(), { signal });
  }

  private point(x: number, y: number): void {
    if (this.forces.isBusy) return this.pointAt(null, x, y);
    const id = this.hit(x, y);
    this.renderer.domElement.style.cursor = id !== null && this.forces.rules?.allows(id) ? "crosshair" : "";
    this.pointAt(id, x, y);
  }

  private hit(x: number, y: number): string | null {
    const { camera, world, container } = this;
    const unseen = unseenOf(this.drawing, this.read);
    return objectAt([x, y], { camera, world, container, objects: this.objects(), unseen, seen: (at) => this.seen(at) });
  }

  private pointAt(id: string | null, x: number, y: number): void {
    if (id !== this.pointed) this.mark(id);
    this.hover?.(id, x, y);
  }

  private press(event: KeyboardEvent): void {
    if (event.target !== this.container || event.ctrlKey || event.altKey || event.metaKey) return;
    if (orbitBy(event.key, this.camera, this.controls)) this.draw();
    else if (event.key === "0" && this.aim.subject) this.frame(this.aim.subject.moments, this.aim.subject.marks);
    else return;
    event.preventDefault();
  }
}
