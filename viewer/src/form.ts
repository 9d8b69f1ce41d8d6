/** Forms for tools, made from their schemas: a field for each argument, with what it means and its unit. */

import { element } from "./markup.js";
import type { Call, Schema, Tool } from "./talk.js";

/** A field: its elements, and its value; undefined leaves the argument out. */
interface Field {
  shown: HTMLElement;
  value: () => unknown;
}

const COMPONENTS: Record<number, string[]> = { 3: ["x", "y", "z"], 4: ["w", "x", "y", "z"] };
const COLOURS = ["red", "green", "blue", "opacity"];

/** A form that makes calls of one tool. */
export class ToolForm {
  readonly element: HTMLElement;
  private readonly fields: Map<string, Field>;

  /**
   * @param tool - Which tool.
   * @param objects - Ids of the objects that are known.
   */
  constructor(
    private readonly tool: Tool,
    objects: string[],
  ) {
    const { properties = {}, required = [] } = tool.input_schema;
    this.fields = new Map(
      Object.entries(properties).map(([name, schema]) => [
        name,
        fieldOf(name, schema, required.includes(name), objects),
      ]),
    );
    const shown = [...this.fields.values()].map((field) => field.shown);
    this.element = element(
      "div",
      { class: "play-form" },
      element("p", { class: "play-soft" }, tool.description),
      ...shown,
    );
  }

  /** The call as it is filled in; throws a sentence if a field holds no value of its kind. */
  call(): Call {
    const found: Record<string, unknown> = {};
    for (const [name, field] of this.fields) {
      const value = field.value();
      if (value !== undefined) found[name] = value;
    }
    return { tool: this.tool.name, arguments: found };
  }
}

function fieldOf(name: string, schema: Schema, required: boolean, objects: string[]): Field {
  const forms = schema.anyOf ?? [schema];
  const kinds = new Set(forms.map((form) => form.type));
  if (name === "answer") return answerField(schema);
  if (/^(object_id|obj\d_id|object\d_id)$/.test(name)) return choice(name, schema, objects);
  if (schema.enum) return choice(name, schema, schema.enum);
  if (kinds.has("boolean")) return checkbox(name, schema);
  const list = forms.find((form) => form.type === "array");
  if (list) return vector(name, schema, list, required);
  if (kinds.has("object")) return json(name, schema);
  if (kinds.has("number")) return number(name, schema, required);
  return text(name, schema, required);
}

function labelled(name: string, schema: Schema, ...inputs: HTMLElement[]): HTMLElement {
  const said = element("span", {}, element("b", {}, name), ` ${schema.description ?? ""}`);
  const tag = inputs.length > 1 ? "fieldset" : "label";
  return element(tag, { class: "play-field" }, tag === "fieldset" ? element("legend", {}, said) : said, ...inputs);
}

function choice(name: string, schema: Schema, options: string[]): Field {
  const select = element("select", { name }, ...options.map((option) => element("option", { value: option }, option)));
  if (typeof schema.default === "string") select.value = schema.default;
  return { shown: labelled(name, schema, select), value: () => select.value };
}

function checkbox(name: string, schema: Schema): Field {
  const box = element("input", { type: "checkbox", name });
  box.checked = schema.default === true;
  return { shown: labelled(name, schema, box), value: () => box.checked };
}

function number(name: string, schema: Schema, required: boolean): Field {
  const input = element("input", { name, inputmode: "decimal", autocomplete: "off" });
  if (typeof schema.default === "number") input.value = `${schema.default}`;
  return { shown: labelled(name, schema, input), value: () => numberIn(name, input, required) };
}

function numberIn(name: string, input: HTMLInputElement, required: boolean): number | undefined {
  const written = input.value.trim();
  // Three digits after a comma may be decimals or thousands, and a wrong guess would cost an experiment.
  if (/^[-−+]?\d{1,3},\d{3}$/.test(written)) {
    throw new Error(`${name}: ${written} can be read in two ways; write ${written.replace(",", ".")} or ${written.replace(",", "")}`);
  }
  const typed = written.replace(",", ".").replace("−", "-");
  if (typed === "" && !required) return undefined;
  const value = Number(typed);
  if (typed === "" || !Number.isFinite(value)) throw new Error(`${name}: ${typed || "nothing"} is not a number`);
  return value;
}

function vector(name: string, schema: Schema, list: Schema, required: boolean): Field {
  const size = list.maxItems ?? 3;
  const names = name === "rgba" ? COLOURS : (COMPONENTS[size] ?? []);
  const inputs = names.map((component) =>
    element("input", {
      name: `${name}.${component}`,
      inputmode: "decimal",
      autocomplete: "off",
      "aria-label": component,
      placeholder: component,
    }),
  );
  if (name === "rgba") inputs.forEach((input) => (input.value = "1"));
  const value = () => {
    const filled = inputs.filter((input) => input.value.trim() !== "");
    if (filled.length === 0 && !required) return undefined;
    return inputs.map((input, index) => numberIn(`${name} ${names[index]}`, input, true));
  };
  return { shown: labelled(name, schema, ...inputs), value };
}

function text(name: string, schema: Schema, required: boolean): Field {
  const input = element("input", { name, autocomplete: "off" });
  const value = () => {
    if (input.value !== "" || !required) return input.value || undefined;
    throw new Error(`${name} is missing`);
  };
  return { shown: labelled(name, schema, input), value };
}

function json(name: string, schema: Schema): Field {
  const input = element("input", { name, autocomplete: "off", placeholder: '{"mass": 2.5}' });
  const value = () => {
    if (input.value.trim() === "") return undefined;
    try {
      return JSON.parse(input.value) as unknown;
    } catch {
      throw new Error(`${name}: ${input.value} is not like {"mass": 2.5}`);
    }
  };
  return { shown: labelled(name, schema, input), value };
}

/** An answer is a number or a list if it is written as one in JSON, and a text otherwise. */
function answerField(schema: Schema): Field {
  const input = element("input", { name: "answer", autocomplete: "off" });
  const value = () => {
    const typed = input.value.trim();
    if (typed === "") throw new Error("answer is missing");
    try {
      const parsed: unknown = JSON.parse(typed);
      return typeof parsed === "number" || Array.isArray(parsed) ? parsed : typed;
    } catch {
      return typed;
    }
  };
  return { shown: labelled("answer", schema, input), value };
}
