/** The page of a person who plays: a question, the scene, a bench of tools, what was measured, and the budget. */

import { AnswerBox } from "./answer_box.js";
import { Bench } from "./bench.js";
import { chartOf } from "./chart.js";
import { endCard } from "./end_card.js";
import { beyond, limitsInWords } from "./limits.js";
import { rendered } from "./markdown.js";
import { element } from "./markup.js";
import { LabPanel } from "./panel.js";
import { type Known, type Names, namesOf } from "./plain.js";
import { changedOf, latestOf, seriesOf } from "./readings.js";
import { lastResults, logRows } from "./results.js";
import { type Call, Elsewhere, type Exchange, leave, type State, stateAfter, take, takeOver } from "./talk.js";
import { VisitorCard } from "./visitor.js";

/** Largest number of plots. */
const MOST_PLOTS = 6;
const dark = matchMedia("(prefers-color-scheme: dark)");
const reducedMotion = matchMedia("(prefers-reduced-motion: reduce)").matches;
const by = (id: string) => document.getElementById(id)!;
const note = by("note") as HTMLTextAreaElement;
const leaving = by("leave") as HTMLButtonElement;

let state: State | null = null;
const panel = new LabPanel(by("lab"), { dark: dark.matches, reducedMotion, readings, names: (id) => names()(id) });
const bench = new Bench({ run, say });
const answer = new AnswerBox((call) => take([call], note.value.trim()));
const visitor = new VisitorCard(by("consent"), by("clock"), (sentence) => (by("budget").textContent = sentence));
panel.allowForces({
  allows: (id) => bench.offers("apply_force") && state?.rules.limits?.force !== 0 && !sealed().has(id),
  limit: () => state?.rules.limits?.force ?? null,
  drawn: (id, [x, y, z]) => {
    const force = { "force_vector.x": `${x}`, "force_vector.y": `${y}`, "force_vector.z": `${z}` };
    bench.fill("apply_force", { object_id: id, ...force });
    panel.say(`The form holds the force [${x}, ${y}, ${z}] N on ${names()(id)}. It acts once you run it and let time pass.`);
  },
});
by("bench").append(bench.element);
by("answers").append(answer.element);

function exchanges(): Exchange[] {
  return state?.turns.flatMap((turn) => turn.exchanges) ?? [];
}

/** Numbers come from calls alone: what was read last of an object, not where it is. */
function readings(id: string): string[] {
  const read = latestOf(exchanges(), id);
  return read.length > 0 ? read : ["nothing was read of it yet"];
}

/** The objects that are known: those of the prompt, and those that results named. */
function objects(): Known[] {
  const found = new Map((state?.scene.objects ?? []).map(({ object_id: id, name }) => [id, name]));
  const search = (value: unknown): void => {
    if (!value || typeof value !== "object") return;
    const { object_id: id } = value as { object_id?: unknown };
    if (typeof id === "string" && !found.has(id)) found.set(id, "");
    for (const part of Object.values(value)) search(part);
  };
  for (const exchange of exchanges()) search(exchange.content);
  return [...found].map(([id, name]) => ({ id, name }));
}

/** Objects that the task lets nobody act on, as the prompt names them. */
function sealed(): Set<string> {
  const [, listed = ""] = /^Sealed, to be observed but not acted on: (.*)\.$/m.exec(state?.prompt ?? "") ?? [];
  return new Set(listed.split(", "));
}

/** What the objects are called now. */
function names(): Names {
  return namesOf(objects());
}

function say(sentence: string): void {
  by("said").textContent = sentence;
}

/** Make the calls of an iteration; false if they were not sent, or the command refused them. */
async function run(calls: Call[]): Promise<boolean> {
  const refusal = beyond(calls, state?.rules.limits ?? {}, exchanges());
  if (refusal) {
    say(`Not sent: ${refusal}.`);
    return false;
  }
  try {
    await take(calls, note.value.trim());
    note.value = "";
    return true;
  } catch (failure) {
    say((failure as Error).message);
    return false;
  }
}

function showTask(next: State): void {
  const { name = "", task = "" } = next.scene;
  document.title = `${name} · PhysMent laboratory`;
  by("question").querySelector("h2")!.textContent = name;
  by("task").textContent = task;
  by("prompt").replaceChildren(...rendered(next.prompt ?? ""));
  by("question").hidden = false;
  answer.show(next);
}

function showMeasured(next: State): void {
  answer.returned(next);
  by("last").replaceChildren(...lastResults(next.turns, names()));
  by("log").replaceChildren(...logRows(next.turns, names()));
  const changed = changedOf(seriesOf(exchanges(), names())).slice(0, MOST_PLOTS);
  by("plots").hidden = changed.length === 0;
  by("charts").replaceChildren(...changed.map(chartOf));
}

function showLimits(next: State): void {
  const limits = limitsInWords(next.rules.limits ?? {}, exchanges());
  by("limits").textContent = limits.length > 0 ? `Limits: ${limits.join("; ")}.` : "";
}

function show(next: State): void {
  const before = state;
  // Another episode starts with an empty page.
  if (before && before.number !== next.number) return location.reload();
  state = next;
  if (!before?.prompt && next.prompt) showTask(next);
  const isOpen = next.waiting && next.ended === null;
  if (next.person) visitor.show(next.person, next.ended !== null);
  // There is nothing to do before the consent, and nothing to see if the time ended without an episode.
  document.body.classList.toggle("play-waits", next.person !== undefined && !next.prompt);
  bench.update(next, objects());
  answer.open(isOpen);
  leaving.disabled = !isOpen;
  by("budget").textContent =
    next.ended ??
    (next.person?.agreed === false ? "" : next.budget === undefined ? "opening …" : `${next.left} of ${next.budget} iterations left${isOpen ? "" : " · running …"}`);
  if (next.view && JSON.stringify(next.view) !== JSON.stringify(before?.view ?? null)) panel.show(next.view);
  panel.refresh(next.read);
  showLimits(next);
  if (before?.turns.length !== next.turns.length) showMeasured(next);
  if (next.ended !== null && before?.ended !== next.ended) showEnd(next);
}

function showEnd(next: State): void {
  by("end").replaceChildren(...endCard(next, (sentence) => by("end").append(element("p", { role: "alert" }, sentence))));
  by("end").hidden = false;
  by("end").focus({ preventScroll: true });
  // After the layout of all that changed with the end; at once, which is no motion.
  requestAnimationFrame(() => by("end").scrollIntoView({ block: "start", behavior: "instant" }));
}

function shut(): void {
  bench.shut();
  answer.open(false);
  leaving.disabled = true;
  for (const button of by("end").querySelectorAll("button")) button.disabled = true;
  for (const link of by("end").querySelectorAll("a")) link.replaceWith("The report is in the run folder.");
}

async function follow(): Promise<void> {
  for (;;) {
    try {
      show(await stateAfter(state?.version ?? -1));
    } catch (failure) {
      shut();
      by("elsewhere").hidden = !(failure instanceof Elsewhere);
      // A page that never showed the episode has only empty boxes. One that did keeps its readings.
      if (failure instanceof Elsewhere && !state) document.body.classList.add("play-waits");
      if (failure instanceof TypeError) by("budget").textContent = `${state?.ended ?? ""} ${state?.person ? "This page is closed." : "The command has ended."}`.trim();
      else if (!(failure instanceof Elsewhere)) say((failure as Error).message);
      return;
    }
  }
}

function dress(): void {
  document.documentElement.dataset["theme"] = dark.matches ? "dark" : "light";
  panel.setDark(dark.matches);
}

by("turn").addEventListener("submit", (event) => {
  event.preventDefault();
  bench.submit();
});
leaving.addEventListener("click", () => {
  if (confirm("Leave without an answer? The episode ends.")) void leave();
});
by("take").addEventListener("click", () => {
  void takeOver().then(() => location.reload());
});
dark.addEventListener("change", dress);
dress();
void follow();
