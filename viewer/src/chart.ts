/** Readings over time as lines in SVG. */

import type { Reading, Series } from "./readings.js";
import { shortened } from "./readings.js";

const SVG = "http://www.w3.org/2000/svg";
const [WIDTH, HEIGHT, LEFT, RIGHT, BELOW, ABOVE] = [320, 150, 58, 22, 22, 8];

/** A chart of one quantity: a line for each component, with its name at the end, and the range on both axes. */
export function chartOf({ name, unit, components }: Series): HTMLElement {
  const all = [...components.values()].flat();
  const [from, to] = rangeOf(all.map(({ time }) => time));
  const [low, high] = rangeOf(all.map(({ value }) => value));
  const x = (time: number) => LEFT + ((time - from) / (to - from)) * (WIDTH - LEFT - RIGHT);
  const y = (value: number) => HEIGHT - BELOW - ((value - low) / (high - low)) * (HEIGHT - BELOW - ABOVE);
  const title = unit ? `${name} [${unit}]` : name;
  const chart = made("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "play-chart", role: "img" });
  chart.setAttribute("aria-label", `${title}: ${[...components].map(([part, one]) => told(part, one)).join("; ")}`);
  chart.append(
    made("line", { x1: LEFT, y1: HEIGHT - BELOW, x2: WIDTH - RIGHT, y2: HEIGHT - BELOW }),
    made("line", { x1: LEFT, y1: ABOVE, x2: LEFT, y2: HEIGHT - BELOW }),
    words(low, LEFT - 5, HEIGHT - BELOW, "end"),
    words(high, LEFT - 5, ABOVE + 8, "end"),
    words(`${label(from)} s`, LEFT, HEIGHT - 6, "start"),
    words(`${label(to)} s`, WIDTH - RIGHT, HEIGHT - 6, "end"),
  );
  for (const [part, readings] of components) {
    const points = [...readings].sort((one, other) => one.time - other.time);
    const line = points.map(({ time, value }) => `${x(time)},${y(value)}`).join(" ");
    const last = points.at(-1)!;
    const group = made("g", { class: `play-line play-line-${part || "only"}` });
    group.append(
      made("polyline", { points: line }),
      ...points.map(({ time, value }) => made("circle", { cx: x(time), cy: y(value), r: 2.5 })),
      words(part, x(last.time) + 6, y(last.value) + 4, "start"),
    );
    chart.append(group);
  }
  const figure = document.createElement("figure");
  const caption = document.createElement("figcaption");
  caption.textContent = title;
  figure.append(caption, chart);
  return figure;
}

function told(part: string, readings: Reading[]): string {
  const [first, last] = [readings[0]!, readings.at(-1)!];
  const name = part ? `${part} ` : "";
  return `${name}from ${label(first.value)} at ${label(first.time)} s to ${label(last.value)} at ${label(last.time)} s`;
}

function label(value: number): string {
  return shortened(Number(value.toPrecision(4)));
}

function rangeOf(values: number[]): [number, number] {
  const [low, high] = [Math.min(...values), Math.max(...values)];
  return high > low ? [low, high] : [low - 0.5, high + 0.5];
}

function words(said: number | string, x: number, y: number, anchor: string): SVGElement {
  const text = made("text", { x, y, "text-anchor": anchor });
  text.textContent = typeof said === "string" ? said : label(said);
  return text;
}

function made(name: string, attributes: Record<string, string | number>): SVGElement {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, `${value}`);
  return element;
}
