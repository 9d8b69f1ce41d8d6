/** The box for the answer: a field for each part with its unit, and a question before it is sent. */

import { LawField } from "./law_field.js";
import { element } from "./markup.js";
import { numberFrom } from "./numbers.js";
import { shortened } from "./readings.js";
import type { AnswerForm, Call, State } from "./talk.js";

/** Reads its field; throws a sentence if it holds no answer. */
type Reader = () => unknown;

export class AnswerBox {
  readonly element = element("form", { class: "play-card", id: "answer", "aria-label": "Answer" });
  private readonly dialog = element("dialog", { class: "play-dialog" });
  private readonly said = element("p", { class: "play-said", role: "alert" });
  private readonly button = element("button", { type: "submit", id: "give", disabled: "" }, "Answer …");
  private read: Reader = () => undefined;
  private steps: [string, HTMLInputElement][] = [];
  private law: LawField | null = null;
  private unit = "";

  /** @param give - Sends the call; the sentence of its refusal is shown here. */
  constructor(private readonly give: (call: Call) => Promise<void>) {
    this.element.addEventListener("submit", (event) => {
      event.preventDefault();
      this.ask();
    });
  }

  /** Show the fields for an episode. */
  show(state: State): void {
    const form = state.scene.answer ?? {};
    this.unit = typeof form.unit === "string" && form.unit !== "1" ? form.unit : "";
    const fields = this.fieldsOf(form);
    this.steps = (state.rules.steps ?? []).map(({ name }) => [name, input(`step:${name}`)]);
    const optional = (state.rules.steps ?? []).map(({ name, meaning, unit }, index) =>
      element("label", { class: "play-field" }, element("span", {}, element("b", {}, meaning), ` [${unit}], optional `, element("small", { class: "play-wire" }, name)), this.steps[index]![1]),
    );
    const stated = state.tools.find(({ name }) => name === "answer")?.input_schema.properties?.["law"];
    this.law = stated ? new LawField(stated.description ?? "", state.scene.objects?.[0]?.object_id ?? "object_1") : null;
    const told = /# Answer\n\n([^#]*)/.exec(state.prompt ?? "")?.[1]?.trim() ?? "";
    const law = this.law ? [this.law.element] : [];
    this.element.replaceChildren(
      element("h2", {}, "Answer"),
      element("div", { class: "play-answers" }, ...fields, ...optional, ...law, this.said, this.button),
      element("p", { class: "play-soft" }, told),
      this.dialog,
    );
  }

  /** Whether an answer can be given now. */
  open(isOpen: boolean): void {
    this.button.disabled = !isOpen;
  }

  /** Show why the laboratory refused the answer, if it did so in the last iteration. */
  returned(state: State): void {
    const refused = state.turns.at(-1)?.exchanges.find((one) => one.tool === "answer" && one.is_error);
    if (refused) this.tell(refused.text);
  }

  /** Show a refusal beside the field that it is about; empty for none. */
  private tell(sentence: string): void {
    const isOfLaw = this.law !== null && /^answer: law\b/.test(sentence);
    this.law?.tell(isOfLaw ? sentence : "");
    this.said.textContent = isOfLaw ? "" : sentence;
  }

  private fieldsOf({ kind, unit, labels = [], options = [] }: AnswerForm): HTMLElement[] {
    if (kind === "number") {
      const field = input("answer", "decimal");
      this.read = () => numberFrom("answer", field.value);
      return [labelled("answer", field, this.unit)];
    }
    const parts = labels.length > 0 ? labels : Array.isArray(unit) ? unit.map((_, index) => `number ${index + 1}`) : [];
    if (kind === "numbers" && parts.length > 0) {
      const fields = parts.map((_, index) => input(`answer.${index}`, "decimal"));
      this.read = () => fields.map((field, index) => numberFrom(parts[index]!, field.value));
      return fields.map((field, index) => {
        const own = Array.isArray(unit) ? (unit[index] ?? "") : this.unit;
        return labelled(parts[index]!, field, own === "1" ? "" : own);
      });
    }
    if (options.length > 0) {
      const select = element("select", { name: "answer" }, element("option", { value: "" }, "choose …"));
      select.append(...options.map((option) => element("option", { value: option }, option)));
      this.read = () => {
        if (select.value === "") throw new Error("answer is missing");
        return select.value;
      };
      return [labelled("answer", select, "")];
    }
    const field = input("answer");
    this.read = () => written(field.value);
    return [labelled("answer", field, this.unit)];
  }

  private ask(): void {
    this.tell("");
    try {
      const answer = this.read();
      const steps = this.steps
        .filter(([, field]) => field.value.trim() !== "")
        .map(([name, field]) => [name, numberFrom(name, field.value)] as const);
      const law = this.law?.value();
      const given = { answer, ...(steps.length > 0 ? { steps: Object.fromEntries(steps) } : {}), ...(law === undefined ? {} : { law }) };
      this.confirm({ tool: "answer", arguments: given });
    } catch (refusal) {
      this.tell((refusal as Error).message);
    }
  }

  private confirm(call: Call): void {
    const shown = [shortened(call.arguments["answer"]), this.unit].filter((part) => part !== "").join(" ");
    const yes = element("button", { type: "button", id: "confirm" }, "Give this answer");
    const no = element("button", { type: "button" }, "Back");
    yes.addEventListener("click", () => {
      this.dialog.close();
      this.give(call).catch((refusal: unknown) => this.tell((refusal as Error).message));
    });
    no.addEventListener("click", () => this.dialog.close());
    const withLaw = "law" in call.arguments ? " Your law goes with it. If the laboratory cannot read the law, the iteration is used, and you can answer again." : "";
    this.dialog.replaceChildren(
      element("p", { class: "play-answer" }, shown),
      element("p", {}, `You can answer once; the answer takes an iteration and ends the episode.${withLaw}`),
      element("p", { class: "play-buttons" }, yes, no),
    );
    this.dialog.setAttribute("aria-label", `Answer ${shown}?`);
    this.dialog.showModal();
    yes.focus();
  }
}

function input(name: string, mode = "text"): HTMLInputElement {
  return element("input", { name, inputmode: mode, autocomplete: "off" });
}

function labelled(name: string, field: HTMLElement, unit: string): HTMLElement {
  return element(
    "label",
    { class: "play-field" },
    element("span", {}, element("b", {}, name)),
    field,
    ...(unit ? [element("span", { class: "play-unit" }, unit)] : []),
  );
}

/** A number or a list if it is written as one in JSON, and a text otherwise. */
function written(value: string): unknown {
  const typed = value.trim();
  if (typed === "") throw new Error("answer is missing");
  try {
    const parsed: unknown = JSON.parse(typed);
    return typeof parsed === "number" || Array.isArray(parsed) ? parsed : typed;
  } catch {
    return typed;
  }
}
