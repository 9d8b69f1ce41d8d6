/** Forms for tools, made from their schemas: a field for each argument, with what it means and its unit. */

import { element } from "./markup.js";
import { numberFrom } from "./numbers.js";
import { argumentInWords, type Known, toolInWords, wireName } from "./plain.js";
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
   * @param objects - The objects that are known.
   */
  constructor(
    readonly tool: Tool,
    objects: Known[],
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
      element("p", { class: "play-tool" }, element("b", {}, toolInWords(tool.name)), ...wireName(tool.name, "")),
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

function fieldOf(name: string, schema: Schema, required: boolean, objects: Known[]): Field {
  const forms = schema.anyOf ?? [schema];
  const kinds = new Set(forms.map((form) => form.type));
  if (/^(object_id|obj\d_id|object\d_id)$/.test(name)) return objectField(name, objects);
  if (schema.enum) return choice(name, schema, schema.enum);
  if (kinds.has("boolean")) return checkbox(name, schema);
  const list = forms.find((form) => form.type === "array");
  if (list?.maxItems !== undefined && COMPONENTS[list.maxItems]) return vector(name, schema, list, required);
  if (kinds.has("number")) return number(name, schema, required);
  return text(name, schema, required);
}

function labelled(name: string, schema: Schema, ...inputs: HTMLElement[]): HTMLElement {
  const words = argumentInWords(name);
  const said = element("span", {}, element("b", {}, words), ...wireName(name, words), ` ${schema.description ?? ""}`);
  const tag = inputs.length > 1 ? "fieldset" : "label";
  return element(tag, { class: "play-field" }, tag === "fieldset" ? element("legend", {}, said) : said, ...inputs);
}

/** A choice among objects, by id and name. */
export function objectChoice(name: string, objects: Known[]): HTMLSelectElement {
  const options = objects.map(({ id, name: called }) =>
    element("option", { value: id }, called && called !== id ? `${called} · ${id}` : id),
  );
  return element("select", { name }, ...options);
}

function objectField(name: string, objects: Known[]): Field {
  const select = objectChoice(name, objects);
  // A tool of two objects starts with two different ones.
  if (name.includes("2") && objects.length > 1) select.selectedIndex = 1;
  // The list says what an id is.
  return { shown: labelled(name, {}, select), value: () => select.value };
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
  // Coordinates and shifts are components: an empty one is 0.
  const isComponent = /^d?[xyz]$/.test(name);
  const input = element("input", { name, inputmode: "decimal", autocomplete: "off" });
  if (isComponent) input.placeholder = "0";
  if (typeof schema.default === "number") input.value = `${schema.default}`;
  const value = () => {
    if (input.value.trim() !== "") return numberFrom(argumentInWords(name), input.value, schema);
    if (isComponent) return 0;
    return required ? numberFrom(argumentInWords(name), input.value, schema) : undefined;
  };
  const shown = labelled(name, schema, input);
  if (isComponent) shown.classList.add("play-component");
  return { shown, value };
}

/** Empty components are 0; a vector that may be left out is left out if all of them are empty. */
function vector(name: string, schema: Schema, list: Schema, required: boolean): Field {
  const names = name === "rgba" ? COLOURS : (COMPONENTS[list.maxItems ?? 3] ?? []);
  const inputs = names.map((component) =>
    element("input", {
      name: `${name}.${component}`,
      inputmode: "decimal",
      autocomplete: "off",
      "aria-label": `${argumentInWords(name)} ${component}`,
      placeholder: "0",
    }),
  );
  const shown = inputs.map((input, index) =>
    element("span", { class: "play-component" }, element("span", { "aria-hidden": "true" }, names[index]!), input),
  );
  if (name === "rgba") inputs.forEach((input) => (input.value = "1"));
  const value = () => {
    const isEmpty = inputs.every((input) => input.value.trim() === "");
    if (isEmpty && !required) return undefined;
    return inputs.map((input, index) =>
      input.value.trim() === "" ? 0 : numberFrom(`${argumentInWords(name)} ${names[index]}`, input.value, list.items),
    );
  };
  return { shown: labelled(name, schema, ...shown), value };
}

function text(name: string, schema: Schema, required: boolean): Field {
  const input = element("input", { name, autocomplete: "off" });
  const value = () => {
    if (input.value !== "" || !required) return input.value || undefined;
    throw new Error(`${argumentInWords(name)} is missing`);
  };
  return { shown: labelled(name, schema, input), value };
}
