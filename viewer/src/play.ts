/** The page of a person who plays: scene, task, tools as forms, what was measured, and the budget. */

import { chartOf } from "./chart.js";
import { ToolForm } from "./form.js";
import { rendered } from "./markdown.js";
import { element } from "./markup.js";
import { LabPanel } from "./panel.js";
import { latestOf, seriesOf, shortened } from "./readings.js";
import { type Call, type Exchange, leave, type State, stateAfter, take } from "./talk.js";

const dark = matchMedia("(prefers-color-scheme: dark)");
const reducedMotion = matchMedia("(prefers-reduced-motion: reduce)").matches;
const by = (id: string) => document.getElementById(id)!;
const tools = by("tool") as HTMLSelectElement;
const note = by("note") as HTMLTextAreaElement;
const quantity = by("quantity") as HTMLSelectElement;
const buttons = ["add", "run", "leave"].map((id) => by(id) as HTMLButtonElement);

let state: State | null = null;
let form: ToolForm | null = null;
let waitingCalls: Call[] = [];
const panel = new LabPanel(by("lab"), { dark: dark.matches, reducedMotion, readings });

function exchanges(): Exchange[] {
  return state?.turns.flatMap((turn) => turn.exchanges) ?? [];
}

/** Numbers come from calls alone: what was read last of an object, not where it is. */
function readings(id: string): string[] {
  const object = state?.scene.objects?.find((one) => one.object_id === id);
  const read = latestOf(exchanges(), id);
  return [...(object ? [object.name] : []), ...(read.length > 0 ? read : ["nothing was read of it yet"])];
}

/** Ids of the objects that are known: those of the prompt, and those that results named. */
function objects(): string[] {
  const found = new Set(state?.scene.objects?.map((one) => one.object_id) ?? []);
  const search = (value: unknown): void => {
    if (!value || typeof value !== "object") return;
    const { object_id: id } = value as { object_id?: unknown };
    if (typeof id === "string") found.add(id);
    for (const part of Object.values(value)) search(part);
  };
  for (const exchange of exchanges()) search(exchange.content);
  return [...found];
}

function showForm(): void {
  const tool = state?.tools.find((one) => one.name === tools.value);
  if (!tool) return;
  form = new ToolForm(tool, objects());
  by("form").replaceChildren(form.element);
}

function typed(call: Call): string {
  return [call.tool, ...Object.values(call.arguments).map(shortened)].join(" ");
}

function showQueue(): void {
  const shown = waitingCalls.map((call, index) => {
    const remove = element("button", { type: "button", "aria-label": `take ${call.tool} away` }, "×");
    remove.addEventListener("click", () => {
      waitingCalls.splice(index, 1);
      showQueue();
    });
    return element("li", {}, `${typed(call)} `, remove);
  });
  by("queue").replaceChildren(...shown);
}

function say(sentence: string): void {
  by("said").textContent = sentence;
}

async function run(): Promise<void> {
  say("");
  try {
    const calls = form ? [...waitingCalls, form.call()] : waitingCalls;
    await take(calls, note.value.trim());
    waitingCalls = [];
    note.value = "";
    showQueue();
  } catch (refusal) {
    say((refusal as Error).message);
  }
}

function add(): void {
  say("");
  try {
    if (form) waitingCalls.push(form.call());
    showQueue();
  } catch (refusal) {
    say((refusal as Error).message);
  }
}

function showLog(): void {
  const turns = state?.turns ?? [];
  const rows = turns.flatMap((turn, index) => [
    ...turn.exchanges.map((exchange) => rowOf(index + 1, exchange)),
    ...(turn.note ? [element("tr", {}, element("td", {}), element("td", { colspan: "2" }, turn.note))] : []),
  ]);
  by("log").replaceChildren(...rows.reverse());
  const series = seriesOf(exchanges());
  const names = [...series.keys()];
  if (names.join() !== [...quantity.options].map((option) => option.value).join()) {
    const before = quantity.value;
    quantity.replaceChildren(...names.map((name) => element("option", { value: name }, name)));
    if (names.includes(before)) quantity.value = before;
  }
  by("plots").hidden = names.length === 0;
  const chosen = series.get(quantity.value);
  by("chart").replaceChildren(...(chosen ? [chartOf(quantity.value, chosen)] : []));
}

function rowOf(turn: number, exchange: Exchange): HTMLTableRowElement {
  const fields = Object.entries(exchange.content ?? {}).filter(([, value]) => value !== null);
  const result =
    exchange.returned && !exchange.is_error
      ? fields.map(([name, value]) => `${name} ${shortened(value)}`).join("; ")
      : exchange.text || "not run";
  const cells = [`${turn}`, typed(exchange), result].map((text) => element("td", {}, text));
  return element("tr", exchange.is_error ? { class: "play-refused" } : {}, ...cells);
}

function show(next: State): void {
  const before = state;
  state = next;
  if (!before?.prompt && next.prompt) {
    by("prompt").replaceChildren(...rendered(next.prompt));
    const usable = next.tools.filter((tool) => !next.scene.disabled_tools?.includes(tool.name));
    tools.replaceChildren(...usable.map((tool) => element("option", { value: tool.name }, tool.name)));
    showForm();
  } else if (before?.turns.length !== next.turns.length) showForm();
  const open = next.waiting && next.ended === null;
  for (const button of buttons) button.disabled = !open;
  by("budget").textContent =
    next.ended ?? `${next.left} of ${next.budget ?? next.left} iterations left${open ? "" : " · running …"}`;
  if (next.view && JSON.stringify(next.view) !== JSON.stringify(before?.view ?? null)) panel.show(next.view);
  else panel.refresh();
  showLog();
}

async function follow(): Promise<void> {
  for (;;) {
    try {
      show(await stateAfter(state?.version ?? -1));
      if (state?.ended) return;
    } catch (failure) {
      say(
        failure instanceof TypeError ? "The command has ended; this page can be closed." : (failure as Error).message,
      );
      for (const button of buttons) button.disabled = true;
      return;
    }
  }
}

function dress(): void {
  document.documentElement.dataset["theme"] = dark.matches ? "dark" : "light";
  panel.setDark(dark.matches);
}

tools.addEventListener("change", showForm);
quantity.addEventListener("change", showLog);
by("add").addEventListener("click", add);
by("turn").addEventListener("submit", (event) => {
  event.preventDefault();
  void run();
});
by("leave").addEventListener("click", () => {
  if (confirm("Leave without an answer? The episode ends.")) void leave();
});
dark.addEventListener("change", dress);
dress();
void follow();
