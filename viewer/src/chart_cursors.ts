/** Lines in the charts of a notebook that stand at the time of its film, or at its call if a chart counts calls. */

const SVG = "http://www.w3.org/2000/svg";
/** Plotted area of a chart: distances from its upper and lower edge. */
const [TOP, BOTTOM] = [8, 22];

interface Cursor {
  line: SVGLineElement;
  /** Coordinate of time 0, or of call 0, and of a second, or a call, after it. */
  origin: number;
  unit: number;
  /** After each call of the film, how many calls the chart counts; null if its axis is time. */
  calls: number[] | null;
  ends: [number, number];
}

export class ChartCursors {
  private readonly cursors: Cursor[];

  constructor(notebook: Element) {
    const charts = [...notebook.querySelectorAll<SVGSVGElement>("figure.chart > svg")];
    this.cursors = charts.map(cursorIn).filter((cursor) => cursor !== null);
  }

  /** Stand at a simulated time [s], and at a call of the film, which is -1 before the first. */
  place(time: number, call: number): void {
    for (const { line, origin, unit, calls, ends } of this.cursors) {
      const x = origin + (calls ? (calls[call] ?? 0) : time) * unit;
      line.setAttribute("x1", `${x}`);
      line.setAttribute("x2", `${x}`);
      line.setAttribute("visibility", x >= ends[0] && x <= ends[1] ? "visible" : "hidden");
    }
  }

  remove(): void {
    for (const { line } of this.cursors) line.remove();
  }
}

/** A cursor in a chart, whose axis is read off its first and its last label. */
function cursorIn(chart: SVGSVGElement): Cursor | null {
  const labels = [...chart.querySelectorAll("text.x")];
  const [first, last] = [labels[0], labels.at(-1)];
  if (!first || !last || first === last) return null;
  const [from, to] = [first, last].map((label) => Number(label.getAttribute("x"))) as [number, number];
  const [early, late] = [first, last].map((label) => Number(label.textContent)) as [number, number];
  const unit = (to - from) / (late - early);
  if (!Number.isFinite(unit)) return null;
  const line = document.createElementNS(SVG, "line");
  line.setAttribute("class", "film-cursor");
  line.setAttribute("y1", `${TOP}`);
  line.setAttribute("y2", `${chart.viewBox.baseVal.height - BOTTOM}`);
  chart.append(line);
  const calls = chart.dataset["calls"]?.split(" ").map(Number) ?? null;
  return { line, origin: from - early * unit, unit, calls, ends: [from, to] };
}
