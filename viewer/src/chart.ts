/** Readings over time as lines in SVG. */

import type { Reading } from "./readings.js";
import { shortened } from "./readings.js";

const SVG = "http://www.w3.org/2000/svg";
const [WIDTH, HEIGHT, LEFT, BELOW] = [480, 180, 64, 24];

/** A chart of one series, with its least and largest value and instant. */
export function chartOf(name: string, readings: Reading[]): SVGSVGElement {
  const [from, to] = rangeOf(readings.map(({ time }) => time));
  const [low, high] = rangeOf(readings.map(({ value }) => value));
  const x = (time: number) => LEFT + ((time - from) / (to - from)) * (WIDTH - LEFT - 12);
  const y = (value: number) => HEIGHT - BELOW - ((value - low) / (high - low)) * (HEIGHT - BELOW - 12);
  const sorted = [...readings].sort((one, other) => one.time - other.time);
  const chart = made("svg", {
    viewBox: `0 0 ${WIDTH} ${HEIGHT}`,
    class: "play-chart",
    role: "img",
    "aria-label": name,
  });
  chart.append(
    made("line", { x1: LEFT, y1: HEIGHT - BELOW, x2: WIDTH - 12, y2: HEIGHT - BELOW }),
    made("line", { x1: LEFT, y1: 12, x2: LEFT, y2: HEIGHT - BELOW }),
    made("polyline", { points: sorted.map(({ time, value }) => `${x(time)},${y(value)}`).join(" ") }),
    ...sorted.map(({ time, value }) => made("circle", { cx: x(time), cy: y(value), r: 3 })),
    words(low, LEFT - 5, HEIGHT - BELOW, "end"),
    words(high, LEFT - 5, 16, "end"),
    words(from, LEFT, HEIGHT - 8, "start"),
    words(`${shortened(Number(to.toPrecision(4)))} s`, WIDTH - 12, HEIGHT - 8, "end"),
  );
  return chart as SVGSVGElement;
}

function rangeOf(values: number[]): [number, number] {
  const [low, high] = [Math.min(...values), Math.max(...values)];
  return high > low ? [low, high] : [low - 0.5, high + 0.5];
}

function words(said: number | string, x: number, y: number, anchor: string): SVGElement {
  const text = made("text", { x, y, "text-anchor": anchor });
  text.textContent = typeof said === "string" ? said : shortened(Number(said.toPrecision(4)));
  return text;
}

function made(name: string, attributes: Record<string, string | number>): SVGElement {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, `${value}`);
  return element;
}
