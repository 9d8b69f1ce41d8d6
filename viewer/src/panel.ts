/** A view with all that a person needs around it: play and stop, a scrubber, readings, and the same in words. */

import { type Body, type Poses, type Readings, titleOf, type Triple, type View } from "./drawing.js";
import type { ForceRules } from "./force_drag.js";
import { LabView } from "./lab_view.js";
import { canDraw, element } from "./markup.js";
import { posesAt } from "./motion.js";
import { Playback, SPEEDS } from "./playback.js";
import { Schematic } from "./schematic.js";
import { unseenOf } from "./sketch.js";
import { bodyInWords, NOTHING, placeInWords, schematicInWords, STILL, turnInWords, viewInWords } from "./words.js";

/** Instants of a motion that the camera keeps in view. */
const FRAMED = 8;

export interface PanelOptions {
  dark: boolean;
  reducedMotion: boolean;
  /** What to tell of an object instead of its pose, in lines; then no number of a pose is told. */
  readings?: (id: string) => string[];
  /** What an object is called, unless by its name and id. */
  names?: (id: string) => string;
}

export class LabPanel {
  /** Whether a browser without WebGL made it draw outlines. */
  readonly flat = !canDraw();
  readonly picture: LabView | Schematic;
  playback: Playback | null = null;
  private view: View | null = null;
  private shown: Poses = {};
  private read: Readings = {};
  private readonly places: Triple[] = [];
  private pointed: string | null = null;
  private readonly box = element("div", { class: "lab-box", role: "img", tabindex: "0" });
  private readonly tip = element("div", { class: "lab-tip", hidden: "" });
  private readonly note = element("p", { class: "lab-note", role: "status", hidden: "" });
  private readonly play = element("button", { type: "button", class: "lab-play" });
  private readonly scrub = element("input", { type: "range", step: "any", "aria-label": "instant" });
  private readonly clock = element("output", { class: "lab-clock" });
  private readonly speed = element("select", { "aria-label": "speed" });
  private readonly controls = element("div", { class: "lab-controls", hidden: "" });
  private readonly table = element("div", { class: "lab-wide" });
  private readonly objects = element("tbody");
  private readonly words = element("p");
  private readonly help = element("p", { class: "lab-help" });

  constructor(
    container: HTMLElement,
    private readonly options: PanelOptions,
  ) {
    this.controls.append(this.play, this.scrub, this.clock, this.speed);
    const columns = options.readings ? ["read last"] : ["place", "orientation"];
    const heads = ["object", "shape", ...columns].map((text) => element("th", { scope: "col" }, text));
    const head = element("thead", {}, element("tr", {}, ...heads));
    this.table.append(element("table", {}, head, this.objects));
    const inWords = element(
      "details",
      { class: "lab-words" },
      element("summary", {}, "In words"),
      this.words,
      this.table,
    );
    const help =
      "Drag or use the arrow keys to turn; + and −, or after a click the wheel, to zoom; 0 to look from the front; space to play.";
    this.box.append(this.tip);
    container.append(this.box, this.note, this.controls, inWords);
    this.help.append(help);
    if (!this.flat) container.append(this.help);
    this.picture = this.flat ? new Schematic(this.box, options) : new LabView(this.box, options);
    this.picture.onHover((id, x, y) => this.point(id, x, y));
    this.listen();
  }

  /**
   * Show a view.
   *
   * @param view - What is seen.
   * @param play - Whether its motion starts by itself; never does for who asks for less motion.
   */
  show(view: View, play = true): void {
    this.playback?.pause();
    this.view = view;
    const { motion } = view;
    const moved = Object.keys(motion?.poses ?? {}).length > 0;
    this.playback = motion && moved ? new Playback(motion, view.poses, (poses) => this.place(poses)) : null;
    this.picture.setDrawing(view.drawing);
    this.setRead(view.read ?? {});
    this.picture.follow(this.moments(view), this.places);
    this.say(this.noted(view, moved));
    this.listObjects(view);
    this.setControls();
    this.place(view.poses);
    if (play && !this.options.reducedMotion) this.playback?.play();
  }

  /**
   * Tell the readings anew, after there are more of them.
   *
   * @param read - Last readings of all objects; those that are drawn are left out.
   */
  refresh(read?: Readings): void {
    const news = read && this.view && this.setRead(read);
    if (news) {
      this.view = { ...this.view!, read: this.read };
      this.picture.follow(this.moments(this.view), this.places);
      this.say(this.noted(this.view, true));
      this.listObjects(this.view);
    }
    this.place(this.shown);
  }

  /** Take over readings; whether any is new. */
  private setRead(read: Readings): boolean {
    const before = JSON.stringify(this.read);
    this.read = Object.fromEntries(unseenOf(this.view!.drawing, read));
    if (JSON.stringify(this.read) === before) return false;
    if (Object.keys(this.read).length === 0) this.places.length = 0; // another episode has begun
    this.places.push(...Object.values(this.read).map((reading) => reading.position));
    this.picture.setRead(this.read);
    return true;
  }

  private noted(view: View, moved: boolean): string {
    const nothing = view.drawing.bodies.length === 0 && Object.keys(this.read).length === 0;
    const still = view.motion && !moved && view.drawing.bodies.length > 0 ? STILL : "";
    return [nothing ? NOTHING : still, schematicInWords(view.drawing), this.warning()].filter(Boolean).join(" ");
  }

  /** Show a sentence below the picture; none hides it. */
  say(sentence: string): void {
    this.note.textContent = sentence;
    this.note.hidden = sentence === "";
  }

  /** Let people draw forces by dragging objects; an outline does not offer it. */
  allowForces(rules: ForceRules): void {
    if (!(this.picture instanceof LabView)) return;
    this.picture.forces.rules = rules;
    this.help.append(" Where a force may be applied, drag an object to draw it into the form.");
  }

  setDark(dark: boolean): void {
    this.picture.setDark(dark);
  }

  private warning(): string {
    return this.flat ? "This browser draws no three-dimensional pictures (WebGL), so this is an outline." : "";
  }

  private moments({ motion, poses }: View): Poses[] {
    if (!motion) return [poses];
    const last = motion.times.length - 1;
    const picked = Array.from(
      { length: FRAMED },
      (_, index) => motion.times[Math.round((index * last) / (FRAMED - 1))]!,
    );
    return picked.map((time) => posesAt(motion, poses, time));
  }

  private place(poses: Poses): void {
    this.shown = poses;
    this.picture.show(poses);
    const { playback, view } = this;
    if (!view) return;
    if (playback) {
      this.scrub.value = `${playback.time}`;
      this.clock.textContent = `${playback.time.toFixed(3)} s`;
      this.play.textContent = playback.playing ? "❚❚" : "▶";
      this.play.setAttribute("aria-label", playback.playing ? "stop" : "play the last step");
    }
    for (const row of this.objects.rows) this.fillRow(row);
    this.tell();
  }

  private setControls(): void {
    const { playback } = this;
    this.controls.hidden = playback === null;
    if (!playback) return;
    this.scrub.min = `${playback.start}`;
    this.scrub.max = `${playback.end}`;
    this.speed.value = `${playback.speed}`;
  }

  private nameOf(id: string): string {
    return this.options.names?.(id) ?? (this.view ? titleOf(this.view.drawing, id) : id);
  }

  private listObjects(view: View): void {
    const words = viewInWords(view, this.options.readings === undefined, (id) => this.nameOf(id));
    this.words.textContent = words;
    this.box.setAttribute("aria-label", words);
    const rows = view.drawing.bodies.filter((body) => body.object).map((body) => this.rowOf(body));
    this.objects.replaceChildren(...rows);
    this.table.hidden = rows.length === 0;
  }

  private rowOf(body: Body): HTMLTableRowElement {
    const name = element("button", { type: "button" }, this.nameOf(body.id));
    for (const event of ["focus", "pointerenter"]) name.addEventListener(event, () => this.mark(body.id));
    for (const event of ["blur", "pointerleave"]) name.addEventListener(event, () => this.mark(null));
    const row = element("tr", {}, element("th", { scope: "row" }, name), element("td", {}, bodyInWords(body)));
    row.append(...(this.options.readings ? [element("td")] : [element("td"), element("td")]));
    row.dataset["id"] = body.id;
    return row;
  }

  private fillRow(row: HTMLTableRowElement): void {
    const id = row.dataset["id"] ?? "";
    const pose = this.shown[id];
    const [, , first, second] = row.cells;
    if (this.options.readings) first!.textContent = this.options.readings(id).join("; ");
    else if (pose && first && second) [first.textContent, second.textContent] = [placeInWords(pose), turnInWords(pose)];
  }

  private mark(id: string | null): void {
    this.pointed = id;
    this.picture.mark(id);
  }

  private point(id: string | null, x: number, y: number): void {
    this.pointed = id;
    this.tip.hidden = id === null;
    this.tell();
    const left = Math.min(x + 14, Math.max(0, this.box.clientWidth - this.tip.offsetWidth - 4));
    this.tip.style.transform = `translate(${left}px, ${Math.max(0, y - this.tip.offsetHeight - 6)}px)`;
  }

  private tell(): void {
    const id = this.pointed;
    if (this.tip.hidden || id === null) return;
    const lines = this.options.readings?.(id) ?? this.usualReadings(id);
    this.tip.replaceChildren(element("b", {}, this.nameOf(id)), ...lines.map((line) => element("div", {}, line)));
  }

  private usualReadings(id: string): string[] {
    const body = this.view?.drawing.bodies.find((one) => one.id === id);
    const pose = this.shown[id];
    return [...(body ? [bodyInWords(body)] : []), ...(pose ? [placeInWords(pose), turnInWords(pose)] : [])];
  }

  private listen(): void {
    for (const speed of SPEEDS) {
      const text = speed === 1 ? "real time" : speed < 1 ? `${1 / speed}× slower` : `${speed}× faster`;
      this.speed.append(element("option", { value: `${speed}` }, text));
    }
    this.play.addEventListener("click", () => this.playback?.toggle());
    this.scrub.addEventListener("input", () => {
      const time = Number(this.scrub.value); // stopping shows the present instant in the scrubber
      this.playback?.pause();
      this.playback?.seek(time);
    });
    this.speed.addEventListener("change", () => {
      if (this.playback) this.playback.speed = Number(this.speed.value);
    });
    this.box.addEventListener("keydown", (event) => {
      if (event.key !== " " || event.target !== this.box) return;
      this.playback?.toggle();
      event.preventDefault();
    });
  }
}
