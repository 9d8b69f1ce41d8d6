/** The part of Markdown in which prompts are written: headings, lists, tables, paragraphs. Makes elements, never HTML. */

import { element } from "./markup.js";

/** The blocks of a text. */
export function rendered(text: string): HTMLElement[] {
  return text
    .split(/\n{2,}/)
    .map((block) => block.split("\n").filter((line) => line.trim() !== ""))
    .filter((lines) => lines.length > 0)
    .map(blockOf);
}

function blockOf(lines: string[]): HTMLElement {
  const [first = ""] = lines;
  const heading = /^(#+) (.*)/.exec(first);
  if (heading) return element("h3", {}, heading[2] ?? "");
  if (first.startsWith("|")) return tableOf(lines);
  if (lines.every((line) => line.startsWith("- "))) {
    return element("ul", {}, ...lines.map((line) => element("li", {}, line.slice(2))));
  }
  if (first.startsWith("```")) return element("pre", {}, lines.slice(1, -1).join("\n"));
  return element("p", {}, lines.join(" "));
}

function tableOf([head = "", , ...rows]: string[]): HTMLElement {
  const cells = (line: string) =>
    line
      .replace(/^\||\|$/g, "")
      .split("|")
      .map((cell) => cell.trim());
  const top = element("tr", {}, ...cells(head).map((cell) => element("th", { scope: "col" }, cell)));
  const body = rows.map((row) => element("tr", {}, ...cells(row).map((cell) => element("td", {}, cell))));
  const table = element("table", {}, element("thead", {}, top), element("tbody", {}, ...body));
  return element("div", { class: "lab-wide" }, table);
}
