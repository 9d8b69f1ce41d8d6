/** What calls returned: the last iteration beside the button, and all of them in a table. */

import { element } from "./markup.js";
import { type Names, shownCall } from "./plain.js";
import { measured } from "./readings.js";
import type { Exchange, State } from "./talk.js";

type Turn = State["turns"][number];

/** The results of the last iteration, refusals among them. */
export function lastResults(turns: Turn[], names: Names): HTMLElement[] {
  const last = turns.at(-1);
  if (!last) return [element("p", { class: "play-soft" }, "Nothing was measured yet: let time pass, or read.")];
  const note = last.note ? [element("p", {}, last.note)] : [];
  const clock = last.exchanges.map((one) => one.content?.["sim_time"]).filter((one) => typeof one === "number");
  const head = `Iteration ${turns.length}${clock.length > 0 ? `, at ${Number(clock.at(-1)!.toPrecision(8))} s` : ""}`;
  return [element("p", { class: "play-soft" }, head), element("dl", {}, ...last.exchanges.flatMap((one) => partsOf(one, names))), ...note];
}

function partsOf(exchange: Exchange, names: Names): HTMLElement[] {
  const lines = linesOf(exchange).map((line) => element("dd", {}, line));
  const name = element("dt", {}, ...shownCall(exchange, names));
  if (isRefused(exchange)) for (const part of [name, ...lines]) part.classList.add("play-refused");
  return [name, ...lines];
}

/** A row for each call, the newest first. */
export function logRows(turns: Turn[], names: Names): HTMLElement[] {
  const rows = turns.flatMap((turn, index) => [
    ...turn.exchanges.map((exchange) => {
      const cells = [[`${index + 1}`], shownCall(exchange, names), [linesOf(exchange).join("; ")]];
      const attributes: Record<string, string> = isRefused(exchange) ? { class: "play-refused" } : {};
      return element("tr", attributes, ...cells.map((content) => element("td", {}, ...content)));
    }),
    ...(turn.note ? [element("tr", {}, element("td", {}), element("td", { colspan: "2" }, turn.note))] : []),
  ]);
  return rows.reverse();
}

function isRefused(exchange: Exchange): boolean {
  return !exchange.returned || exchange.is_error;
}

function linesOf(exchange: Exchange): string[] {
  if (!exchange.returned) return [`✗ not run${exchange.text ? `: ${exchange.text}` : ""}`];
  if (exchange.is_error) return [`✗ refused: ${exchange.text}`];
  return Object.entries(exchange.content ?? {})
    .filter(([name, value]) => value !== null && name !== "sim_time")
    .map(([name, value]) => measured(exchange.tool, name, value));
}
