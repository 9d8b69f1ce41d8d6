/** A film in a notebook: the laboratory in motion, beside it the calls of the turn, below it the time. */

import { type Drawing, type Poses, type Readings, titleOf } from "./drawing.js";
import { ChartCursors } from "./chart_cursors.js";
import { FilmCourse, SPEEDS } from "./film_course.js";
import { callChosen, FilmLinks } from "./film_links.js";
import { trackOf } from "./film_track.js";
import { LabView } from "./lab_view.js";
import { canDraw, element } from "./markup.js";
import type { Reel } from "./reel.js";
import { Schematic } from "./schematic.js";
import { NOTHING, placeInWords, schematicInWords } from "./words.js";

/** Instants that the camera keeps in view. */
const FRAMED = 12;
const OUTLINE = "This browser draws no three-dimensional pictures (WebGL), so this is an outline.";
const REVEALED = "Made with --reveal: this film also shows what its agent could not see.";
const AT_REST =
  "Only what stands still may be seen here: what moves is hidden, or what would show it is withheld or differs from" +
  " case to case.";
const READ =
  "What moves may be read here but not watched: a dashed ring stands where each object was read last.";
const HELP =
  "▶ at a call shows it here. Space plays, comma and full stop go from call to call, brackets from iteration to iteration. Drag or arrow keys turn the" +
  " picture, + and − zoom.";

export class FilmPlayer {
  private readonly course: FilmCourse;
  private readonly picture: LabView | Schematic;
  private readonly cursors: ChartCursors;
  private readonly links: FilmLinks;
  private readonly ends = new AbortController();
  private readonly panel = element("div", { class: "film-panel", role: "group", "aria-label": "film" });
  private readonly box = element("div", { class: "film-box", role: "img", tabindex: "0" });
  private readonly side = element("div", {
    class: "film-calls",
    tabindex: "0",
    role: "region",
    "aria-label": "calls of the turn",
  });
  private readonly toggle = element("button", { type: "button", class: "film-play" });
  private readonly scrub = element("input", { type: "range", step: "any", "aria-label": "simulated time" });
  private readonly clock = element("output", { class: "film-clock" });
  private readonly speed = element("select", { "aria-label": "speed" });
  private readonly pointed = element("p", { class: "film-pointed" });
  private readonly head = element("h4");
  private readonly way = element("span");
  private drawn: Drawing | null = null;
  private shownTurn = -1;
  private read: Readings = {};

  constructor(
    private readonly place: HTMLElement,
    private readonly reel: Reel,
  ) {
    this.course = new FilmCourse(reel, () => this.update());
    const flat = !canDraw();
    const notes = [flat ? OUTLINE : "", reel.film.revealed ? REVEALED : "", unseen(reel), schematicInWords(reel.everything())];
    const said = notes.filter(Boolean).map((text) => element("p", { class: "film-note" }, text));
    const stage = element("div", { class: "film-stage" }, this.box, this.side);
    this.panel.append(stage, this.controls(), this.pointed, ...said);
    this.panel.append(element("p", { class: "film-help" }, HELP));
    place.append(this.panel);
    place.querySelector<HTMLElement>(":scope > button")!.hidden = true;
    const dark = matchMedia("(prefers-color-scheme: dark)");
    const reducedMotion = matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.picture = flat ? new Schematic(this.box) : new LabView(this.box, { dark: dark.matches, reducedMotion });
    const notebook = place.closest<HTMLElement>(".notebook") ?? place;
    this.cursors = new ChartCursors(notebook);
    this.links = new FilmLinks(place.dataset["entry"] ?? "", this.course);
    this.listen(dark, notebook);
    this.frame();
    this.course.showCall(-1);
    if (!reducedMotion) this.course.play();
    this.toggle.focus({ preventScroll: true });
  }

  /** Take the film away, and let go of what the graphics card holds. */
  close(): void {
    this.ends.abort();
    this.course.pause();
    this.picture.dispose();
    this.cursors.remove();
    this.links.remove();
    this.panel.remove();
    const button = this.place.querySelector<HTMLElement>(":scope > button")!;
    button.hidden = false;
    button.focus({ preventScroll: true });
  }

  private controls(): HTMLElement {
    for (const speed of SPEEDS) {
      const text = speed === 1 ? "real time" : speed < 1 ? `${1 / speed}× slower` : `${speed}× faster`;
      this.speed.append(element("option", { value: `${speed}` }, text));
    }
    this.speed.value = `${this.course.speed}`;
    const track = trackOf(this.course, this.scrub);
    this.toggle.disabled = this.scrub.disabled;
    return element(
      "div",
      { class: "film-controls" },
      this.button("⇤", "previous iteration", () => this.course.showTurn(-1)),
      this.button("←", "call before", () => this.course.showCall(this.course.current - 1)),
      this.toggle,
      this.button("→", "next call", () => this.course.showCall(this.course.current + 1)),
      this.button("⇥", "next iteration", () => this.course.showTurn(1)),
      track,
      this.clock,
      this.speed,
      this.button("close", "close the film", () => this.close(), false),
    );
  }

  private button(text: string, name: string, press: () => void, stops = true): HTMLButtonElement {
    const made = element("button", { type: "button", "aria-label": name, title: name }, text);
    made.addEventListener("click", () => {
      if (stops) this.course.pause();
      press();
    });
    return made;
  }

  /** Choose a camera that sees all that happens; it stays there when objects come and go. */
  private frame(): void {
    const moments: Poses[] = Array.from({ length: FRAMED }, (_, index) =>
      this.reel.poses(Math.round((index * this.reel.end) / (FRAMED - 1))),
    );
    this.picture.setDrawing(this.reel.everything());
    this.picture.frame(moments, this.reel.places());
  }

  private update(): void {
    const { course, reel } = this;
    const drawing = reel.drawing(course.position);
    const poses = reel.poses(course.position);
    if (drawing !== this.drawn) {
      this.drawn = drawing;
      this.picture.setDrawing(drawing, true);
    }
    const read = reel.read(course.current + 1);
    if (read !== this.read) this.picture.setRead((this.read = read));
    this.picture.show(poses);
    this.cursors.place(course.time, course.current);
    const call = course.calls[course.current];
    const turns = reel.film.calls.length;
    const where = call ? `iteration ${call.turn + 1} of ${turns}, call ${call.call + 1}` : "before the first call";
    this.clock.textContent = `${course.time.toFixed(2)} of ${Number(course.end.toFixed(2))} s, ${where}`;
    this.box.setAttribute("aria-label", `The laboratory at ${course.time.toFixed(3)} s, ${where}`);
    this.scrub.value = `${course.time}`;
    this.toggle.textContent = course.playing ? "❚❚" : "▶";
    this.toggle.setAttribute("aria-label", course.playing ? "stop" : "play");
    this.showCalls(call?.turn ?? 0, call?.call ?? -1);
  }

  /** The table of a turn as the notebook has it, with the call that is shown marked. */
  private showCalls(turn: number, call: number): void {
    if (turn !== this.shownTurn) {
      this.shownTurn = turn;
      const section = document.getElementById(`${this.place.dataset["entry"]}-${turn + 1}`);
      const table = section?.querySelector(".calls")?.cloneNode(true) as HTMLElement | undefined;
      for (const node of table?.querySelectorAll("[id]") ?? []) node.removeAttribute("id");
      this.head.textContent = `Iteration ${turn + 1}`;
      this.side.replaceChildren(element("div", { class: "film-head" }, this.head, this.way), ...(table ? [table] : []));
    }
    this.way.replaceChildren(this.links.back(turn, call));
    const rows = [...this.side.querySelectorAll("tbody")];
    rows.forEach((row, index) => {
      if (index === call) row.setAttribute("aria-current", "step");
      else row.removeAttribute("aria-current");
    });
    const row = rows[call];
    if (row) this.side.scrollTop = row.offsetTop + row.offsetHeight / 2 - this.side.clientHeight / 2;
    else this.side.scrollTop = 0;
  }

  private listen(dark: MediaQueryList, notebook: HTMLElement): void {
    const { signal } = this.ends;
    const choose = (event: Event) => {
      const call = callChosen(event);
      if (call === null) return;
      this.course.pause();
      this.course.showCall(call);
      if (this.side.contains(event.target as Node)) return;
      this.panel.scrollIntoView({ block: "nearest" });
      this.toggle.focus({ preventScroll: true });
    };
    notebook.addEventListener("click", choose, { signal });
    this.toggle.addEventListener("click", () => this.course.toggle());
    this.scrub.addEventListener("input", () => {
      const time = Number(this.scrub.value); // stopping shows the present time in the scrubber
      this.course.pause();
      this.course.seek(time);
    });
    this.speed.addEventListener("change", () => (this.course.speed = Number(this.speed.value)));
    dark.addEventListener("change", () => this.picture.setDark(dark.matches), { signal });
    this.picture.onHover((id) => {
      const pose = id === null ? undefined : this.reel.poses(this.course.position)[id];
      this.pointed.textContent = pose ? `${titleOf(this.reel.drawing(this.course.position), id!)}: ${placeInWords(pose)}` : "";
    });
    this.panel.addEventListener("keydown", (event) => this.press(event));
  }

  private press(event: KeyboardEvent): void {
    const typed = event.target instanceof HTMLSelectElement || event.ctrlKey || event.altKey || event.metaKey;
    const onButton = event.target instanceof HTMLButtonElement && event.key === " ";
    if (typed || onButton) return;
    const { course } = this;
    if (event.key === " ") course.toggle();
    else if (event.key === "Escape") this.close();
    else {
      const away = { ",": -1, ".": 1, "[": -1, "]": 1 }[event.key];
      if (away === undefined) return;
      course.pause();
      if (event.key === "," || event.key === ".") course.showCall(course.current + away);
      else course.showTurn(away);
    }
    event.preventDefault();
  }
}

/** Why little or nothing is drawn; empty if something that can move is. */
function unseen(reel: Reel): string {
  if (reel.film.bodies.length > 0) return "";
  if (reel.places().length > 0) return READ;
  return reel.everything().bodies.length > 0 ? AT_REST : NOTHING;
}
