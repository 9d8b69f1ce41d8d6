/** Where the camera is put, and when it moves: seldom, so that the scale of the picture does not jump from step to step. */

import { type PerspectiveCamera, Vector3 } from "three";
import type { OrbitControls } from "three/addons/controls/OrbitControls.js";

import type { Drawing, Poses, Triple } from "./drawing.js";
import { type Camera, cameraFor, FORWARD, thingsOf } from "./framing.js";

/** The far plane is so many extents behind what is looked at. */
const BEHIND = 24;
/** Share of the half picture that counts as inside. */
const INSIDE = 0.98;
/** A camera this many times farther away than necessary comes closer, although it shows all things. */
const TOO_FAR = 20;
/** A camera that turns to other things keeps its distance up to this many times the necessary one. */
const ROOMY = 3;

/** What is to be seen whole. */
export interface Subject {
  drawing: Drawing;
  /** The poses at some moments; at least one. */
  moments: Poses[];
  /** Further places [m]. */
  marks: Triple[];
}

export class Aim {
  /** Where the camera was put last; null if the next thing that is shown has to be framed. */
  framed: Camera | null = null;
  /** What is to be seen now; null before the first. */
  subject: Subject | null = null;

  constructor(
    private readonly camera: PerspectiveCamera,
    private readonly controls: OrbitControls,
    private readonly container: HTMLElement,
  ) {}

  /** Put the camera where a subject fills the picture, and look from the front. */
  frame(subject: Subject): void {
    this.subject = subject;
    this.put(this.fitting(subject));
  }

  /** Move only if something would be outside, and then keep the scale if it can. */
  follow(subject: Subject): void {
    this.subject = subject;
    const fitting = this.fitting(subject);
    const distance = this.camera.position.distanceTo(this.controls.target);
    const stays = this.framed !== null && distance <= TOO_FAR * fitting.distance && this.sees(subject);
    if (!stays) this.put(this.framed ? scaledAs(this.framed, fitting) : fitting);
  }

  private fitting({ drawing, moments, marks }: Subject): Camera {
    const { clientWidth, clientHeight } = this.container;
    return cameraFor(drawing, moments, (clientWidth || 4) / (clientHeight || 3), marks);
  }

  private sees({ drawing, moments, marks }: Subject): boolean {
    this.camera.updateMatrixWorld();
    return thingsOf(drawing, moments, marks).every((point) => {
      const { x, y, z } = new Vector3(...point).project(this.camera);
      return Math.max(Math.abs(x), Math.abs(y)) < INSIDE && Math.abs(z) <= 1;
    });
  }

  private put(found: Camera): void {
    const { camera, controls } = this;
    this.framed = found;
    const centre = new Vector3(...found.centre);
    controls.target.copy(centre);
    camera.position.copy(centre).addScaledVector(new Vector3(...FORWARD), -found.distance);
    camera.near = found.distance / 200;
    camera.far = found.distance + found.extent * BEHIND;
    camera.updateProjectionMatrix();
    controls.minDistance = found.distance / 20;
    controls.maxDistance = found.distance * 8;
    controls.update();
  }
}

/** A new place of the camera, at the old distance if that is not much too far. */
function scaledAs(old: Camera, fitting: Camera): Camera {
  const keeps = old.distance >= fitting.distance && old.distance <= ROOMY * fitting.distance;
  return keeps ? { ...fitting, distance: old.distance, extent: old.extent } : fitting;
}
