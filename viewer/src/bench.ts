/** The bench: tools in groups, a form for the chosen one, and the calls of the next iteration. */

import { objectChoice, ToolForm } from "./form.js";
import { element } from "./markup.js";
import { type Known, callInWords, namesOf, shownCall, toolInWords, wireName } from "./plain.js";
import type { Call, State, Tool } from "./talk.js";

const GROUPS: [string, RegExp][] = [
  ["Time", /^step$/],
  ["Read", /^(get_|compute_|detect_|quat_)/],
  ["Act", /^(move_|change_|set_|apply_)/],
  ["Build", /./],
];
/** Readings that are taken after a step unless the person chooses others. */
const USUAL = ["get_position", "get_velocity"];
/** Duration of a step that the form proposes [s]. */
const USUAL_STEP = "0.1";
const EVERY = "every object";

export interface BenchOptions {
  /** Make the calls of an iteration. */
  run: (calls: Call[]) => Promise<boolean>;
  /** Tell what is wrong; empty for nothing. */
  say: (sentence: string) => void;
}

export class Bench {
  readonly element = element("div", { class: "bench" });
  private readonly groups = element("div", { class: "bench-groups", role: "radiogroup", "aria-label": "kind of tool" });
  private readonly tools = element("div", { class: "bench-tools", role: "radiogroup", "aria-label": "tool" });
  private readonly fields = element("div");
  private readonly list = element("ol", { class: "bench-queue", "aria-label": "calls before this one" });
  private readonly go = element("button", { type: "submit", id: "run", disabled: "" });
  private readonly again = element("button", { type: "button", id: "again", disabled: "" }, "Repeat last");
  private readonly add = element("button", { type: "button", id: "add", disabled: "" }, "Add another call");
  private usable: Tool[] = [];
  private objects: Known[] = [];
  private form: ToolForm | null = null;
  private waiting: Call[] = [];
  private last: Call[] = [];
  private readonly chosen = new Map<string, string>();
  private readonly reads = new Set(USUAL);
  private readOf = "";
  private isOpen = false;

  constructor(private readonly options: BenchOptions) {
    const buttons = element("p", { class: "play-buttons" }, this.go, this.again, this.add);
    this.element.append(this.groups, this.tools, this.fields, this.list, buttons);
    this.add.addEventListener("click", () => this.attempt((calls) => void (this.waiting = calls)));
    this.again.addEventListener("click", () => void this.send(this.last));
    this.fields.addEventListener("input", () => this.label());
  }

  /** Run what is filled in. */
  submit(): void {
    this.attempt((calls) => void this.send(calls));
  }

  /** Show the tools of an episode once, and the objects as they get known. */
  update(state: State, objects: Known[]): void {
    const isFirst = this.usable.length === 0 && state.tools.length > 0;
    const before = this.objects.map(({ id }) => id).join();
    this.objects = objects;
    if (isFirst) {
      const refused = state.scene.disabled_tools ?? [];
      this.usable = state.tools.filter((tool) => tool.name !== "answer" && !refused.includes(tool.name));
      this.listGroups();
    } else if (before !== objects.map(({ id }) => id).join()) this.showForm();
    this.last = (state.turns.at(-1)?.exchanges ?? []).map(({ tool, arguments: given }) => ({ tool, arguments: given }));
    this.isOpen = state.waiting && state.ended === null;
    this.label();
  }

  /** Whether a tool can be used now. */
  offers(name: string): boolean {
    return this.isOpen && this.usable.some((tool) => tool.name === name);
  }

  /**
   * Fill in the form of a tool, and send nothing.
   *
   * @param name - Which tool.
   * @param values - Name of a field → what it holds.
   */
  fill(name: string, values: Record<string, string>): void {
    const [group] = GROUPS.find(([, pattern]) => pattern.test(name))!;
    this.groups.querySelector<HTMLInputElement>(`[value="${group}"]`)?.click();
    this.tools.querySelector<HTMLInputElement>(`[value="${name}"]`)?.click();
    for (const [field, value] of Object.entries(values)) {
      const input = this.fields.querySelector<HTMLInputElement | HTMLSelectElement>(`[name="${field}"]`);
      if (input) input.value = value;
    }
    this.label();
  }

  /** Let nobody run anything. */
  shut(): void {
    this.isOpen = false;
    this.label();
  }

  private attempt(use: (calls: Call[]) => void): void {
    this.options.say("");
    try {
      use([...this.waiting, ...this.calls()]);
    } catch (refusal) {
      this.options.say((refusal as Error).message);
    }
    this.showQueue();
  }

  private async send(calls: Call[]): Promise<void> {
    this.options.say("");
    if (await this.options.run(calls)) this.waiting = [];
    this.showQueue();
  }

  private listGroups(): void {
    const found = new Map<string, Tool[]>(GROUPS.map(([name]) => [name, []]));
    for (const tool of this.usable) {
      const [name] = GROUPS.find(([, pattern]) => pattern.test(tool.name))!;
      found.get(name)!.push(tool);
    }
    const full = [...found].filter(([, tools]) => tools.length > 0);
    this.groups.replaceChildren(
      ...full.map(([name, tools], index) => radio("group", name, index === 0, () => this.listTools(name, tools))),
    );
    const [first] = full;
    if (first) this.listTools(...first);
  }

  private listTools(group: string, tools: Tool[]): void {
    const before = this.chosen.get(group) ?? tools[0]!.name;
    const choose = (name: string) => {
      this.chosen.set(group, name);
      this.showForm(tools.find((tool) => tool.name === name));
    };
    this.tools.replaceChildren(
      ...tools.map(({ name }) => radio("tool", name, name === before, () => choose(name), toolInWords(name))),
    );
    this.tools.hidden = tools.length < 2;
    choose(before);
  }

  private showForm(tool = this.form?.tool): void {
    if (!tool) return;
    this.form = new ToolForm(tool, this.objects);
    this.fields.replaceChildren(this.form.element, ...(tool.name === "step" ? this.readFields() : []));
    const duration = this.fields.querySelector<HTMLInputElement>("[name=duration]");
    if (duration) duration.value ||= USUAL_STEP;
    this.label();
  }

  /** What to read after a step: the tools that need an object and nothing else, and whose readings change with time. */
  private readFields(): HTMLElement[] {
    const tools = this.usable.filter(
      ({ name, input_schema: { properties } }) =>
        /^get_(?!torque|parameters)/.test(name) && Object.keys(properties ?? {}).join() === "object_id",
    );
    if (tools.length === 0 || this.objects.length === 0) return [];
    const boxes = tools.map(({ name }) => {
      const box = element("input", { type: "checkbox", name: "read", value: name });
      box.checked = this.reads.has(name);
      box.addEventListener("change", () => void (box.checked ? this.reads.add(name) : this.reads.delete(name)));
      const words = toolInWords(name);
      return element("label", { class: "bench-read" }, box, ` ${words}`, ...wireName(name, words));
    });
    const several = this.objects.length > 1 ? [{ id: EVERY, name: "" }] : [];
    const of = objectChoice("read_of", [...this.objects, ...several]);
    if (this.readOf) of.value = this.readOf;
    of.addEventListener("change", () => void (this.readOf = of.value));
    const legend = element("legend", {}, element("b", {}, "then read"), " after the step, in the same click");
    return [element("fieldset", { class: "play-field" }, legend, element("label", {}, "of ", of), ...boxes)];
  }

  private calls(): Call[] {
    return this.form ? [this.form.call(), ...this.readings()] : [];
  }

  private readings(): Call[] {
    const of = this.fields.querySelector<HTMLSelectElement>("[name=read_of]")?.value;
    if (of === undefined) return [];
    const tools = [...this.fields.querySelectorAll<HTMLInputElement>("[name=read]:checked")].map((box) => box.value);
    const objects = of === EVERY ? this.objects.map(({ id }) => id) : [of];
    return objects.flatMap((id) => tools.map((tool) => ({ tool, arguments: { object_id: id } })));
  }

  private label(): void {
    const name = this.form?.tool.name;
    const number = this.waiting.length + 1 + this.readings().length;
    const what = this.waiting.length > 0 ? "Run" : name === "step" ? (number > 1 ? "Step and read" : "Step") : "Run";
    const counted = `${number} call${number === 1 ? "" : "s"}, 1 iteration`;
    this.go.replaceChildren(element("b", {}, what), element("small", {}, ` ${counted}`));
    const repeats = this.last.length > 0 && this.last.every((call) => call.tool !== "answer");
    this.again.title = repeats ? this.last.map((call) => callInWords(call, namesOf(this.objects))).join("; ") : "";
    this.go.disabled = this.add.disabled = !this.isOpen;
    this.again.disabled = !this.isOpen || !repeats;
  }

  private showQueue(): void {
    const shown = this.waiting.map((call, index) => {
      const remove = element("button", { type: "button", "aria-label": `take away: ${toolInWords(call.tool)}` }, "×");
      remove.addEventListener("click", () => {
        this.waiting.splice(index, 1);
        this.showQueue();
      });
      return element("li", {}, ...shownCall(call, namesOf(this.objects)), " ", remove);
    });
    this.list.replaceChildren(...shown);
    this.label();
  }
}

function radio(name: string, value: string, checked: boolean, choose: () => void, words = value): HTMLElement {
  const input = element("input", { type: "radio", name, value });
  input.checked = checked;
  input.addEventListener("change", choose);
  return element("label", {}, input, element("span", { title: value }, words));
}
