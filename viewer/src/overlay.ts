/** What lies over the picture as text and lines: labels of objects, axes x y z, a scale bar. */

import { type Camera, type Quaternion, Vector3 } from "three";

import { metres, roundLength } from "./ruler.js";
import { Sketch } from "./sketch.js";

const SVG = "http://www.w3.org/2000/svg";
const AXES = [
  { name: "x", along: new Vector3(1, 0, 0) },
  { name: "y", along: new Vector3(0, 1, 0) },
  { name: "z", along: new Vector3(0, 0, 1) },
];
const AXIS_PX = 26;
/** The scale bar is at most this share of the width. */
const BAR = 0.22;
/** How many of its heights a label moves away from its object at most. */
const FARTHEST = 4;
/** How far a long label is above the middle of the ring that marks where its object was read [px]. */
const RAISED = 13;

export interface Label {
  id: string;
  /** Where its object is [m]. */
  at: Vector3;
}

/** Where a label is: the middle of its lower edge, and its size [px]. */
interface Box {
  x: number;
  y: number;
  width: number;
  height: number;
}

/** The layer over a picture; decoration, since the text alternative says the same. */
export class Overlay {
  readonly element = document.createElement("div");
  private readonly lines = document.createElementNS(SVG, "svg");
  /** Lines above all labels. */
  readonly forces = document.createElementNS(SVG, "svg");
  private readonly axes = document.createElementNS(SVG, "svg");
  private readonly bar = document.createElement("div");
  /** Tells the distance of the lines of the grid. */
  readonly grid = document.createElement("div");
  /** Lines and rings, in pixels. */
  readonly sketch = new Sketch();
  private readonly tags = new Map<string, HTMLElement>();
  private marked: string | null = null;

  constructor() {
    this.element.className = "lab-overlay";
    this.element.setAttribute("aria-hidden", "true");
    this.axes.setAttribute("class", "lab-axes");
    this.axes.setAttribute("viewBox", "-40 -40 80 80");
    this.bar.className = "lab-scale";
    this.grid.className = "lab-grid";
    this.lines.setAttribute("class", "lab-sketch");
    this.lines.append(this.sketch.element);
    this.forces.setAttribute("class", "lab-sketch lab-forces");
    this.element.append(this.lines, this.forces, this.axes, this.bar, this.grid);
  }

  /** Set which objects have labels, and what they say. */
  name(texts: Map<string, string>): void {
    for (const tag of this.tags.values()) tag.remove();
    this.tags.clear();
    for (const [id, text] of texts) {
      const tag = document.createElement("span");
      tag.className = text.includes("\n") ? "lab-label lab-unseen" : "lab-label";
      tag.textContent = text;
      this.tags.set(id, tag);
      this.element.append(tag);
    }
    this.mark(this.marked);
  }

  /** Emphasise one label; null for none. */
  mark(id: string | null): void {
    this.marked = id;
    for (const [name, tag] of this.tags) tag.classList.toggle("lab-marked", name === id);
  }

  /** Put everything where the camera sees it; sizes in CSS pixels. */
  place(camera: Camera, labels: Label[], width: number, height: number, perPixel: number): void {
    this.drawAxes(camera.quaternion);
    const length = roundLength(perPixel * width * BAR);
    this.bar.style.width = `${length / perPixel}px`;
    this.bar.textContent = metres(length);
    this.placeLabels(camera, labels, width, height);
  }

  private placeLabels(camera: Camera, labels: Label[], width: number, height: number): void {
    const placed = this.corners();
    // Long labels first, since they cannot be left out: no other mark shows where their objects were read. Then from
    // bottom to top, so that labels that give way go above the others, away from their own objects.
    const seen = labels
      .map(({ id, at }) => ({ tag: this.tags.get(id), at: at.clone().project(camera) }))
      .sort((one, other) => Number(isLong(other.tag)) - Number(isLong(one.tag)) || one.at.y - other.at.y);
    for (const { tag, at } of seen) {
      if (!tag) continue;
      tag.hidden = at.z > 1 || Math.abs(at.x) > 1 || Math.abs(at.y) > 1;
      if (tag.hidden) continue;
      const box = { x: 0, y: 0, width: Math.min(tag.offsetWidth + 4, width), height: tag.offsetHeight };
      box.x = Math.min(Math.max(((at.x + 1) / 2) * width, box.width / 2), width - box.width / 2);
      const lower = ((1 - at.y) / 2) * height - (isLong(tag) ? RAISED : 0);
      box.y = Math.min(Math.max(lower, box.height), height);
      const free = freePlace(box, placed, height);
      tag.hidden = free === null && !isLong(tag);
      if (tag.hidden) continue;
      const shown = free ?? box;
      placed.push(shown);
      tag.style.transform = `translate(${shown.x}px, ${shown.y}px) translate(-50%, -100%)`;
    }
  }

  /** What labels must not cover. */
  private corners(): Box[] {
    const { left, top } = this.element.getBoundingClientRect();
    return [this.axes, this.bar, this.grid]
      .map((shown) => shown.getBoundingClientRect())
      .map(({ x, bottom, width, height }) => ({ x: x - left + width / 2, y: bottom - top, width, height }))
      .filter(({ width }) => width > 0);
  }

  private drawAxes(camera: Quaternion): void {
    const turn = camera.clone().invert();
    const shown = AXES.map(({ name, along }) => ({ name, at: along.clone().applyQuaternion(turn) }));
    shown.sort((one, other) => one.at.z - other.at.z);
    this.axes.replaceChildren(...shown.flatMap(({ name, at }) => axisOf(name, at)));
  }
}

function isLong(tag: HTMLElement | undefined): boolean {
  return tag?.classList.contains("lab-unseen") ?? false;
}

/**
 * The place nearest to a label's own, above or below it, where it covers no other label and is within the picture. Null
 * if that is farther than `FARTHEST` of its heights: among many objects, nobody could tell whose label it is.
 */
function freePlace(box: Box, others: Box[], height: number): Box | null {
  return (
    [box.y, ...others.flatMap((other) => [other.y - other.height, other.y + box.height])]
      .filter((y) => y >= box.height && y <= height && Math.abs(y - box.y) <= FARTHEST * box.height)
      .sort((one, other) => Math.abs(one - box.y) - Math.abs(other - box.y))
      .map((y) => ({ ...box, y }))
      .find((moved) => !others.some((other) => covers(moved, other))) ?? null
  );
}

function covers(one: Box, other: Box): boolean {
  const beside = Math.abs(other.x - one.x) >= (other.width + one.width) / 2;
  return !beside && other.y > one.y - one.height && one.y > other.y - other.height;
}

function axisOf(name: string, at: Vector3): SVGElement[] {
  const line = document.createElementNS(SVG, "line");
  line.setAttribute("x2", `${at.x * AXIS_PX}`);
  line.setAttribute("y2", `${-at.y * AXIS_PX}`);
  line.setAttribute("class", `lab-axis-${name}`);
  const text = document.createElementNS(SVG, "text");
  text.setAttribute("x", `${at.x * (AXIS_PX + 8)}`);
  text.setAttribute("y", `${-at.y * (AXIS_PX + 8)}`);
  text.setAttribute("class", `lab-axis-${name}`);
  text.textContent = name;
  return [line, text];
}
