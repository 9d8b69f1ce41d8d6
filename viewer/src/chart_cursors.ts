/** Lines in the charts of a notebook that stand at the time of its film. */

const SVG = "http://www.w3.org/2000/svg";
/** Plotted area of a chart: distances from its upper and lower edge. */
const [TOP, BOTTOM] = [8, 22];

interface Cursor {
  line: SVGLineElement;
  /** Coordinate of time 0, and of a second after it. */
  origin: number;
  second: number;
  ends: [number, number];
}

export class ChartCursors {
  private readonly cursors: Cursor[];

  constructor(notebook: Element) {
    const charts = [...notebook.querySelectorAll<SVGSVGElement>("figure.chart > svg")];
    this.cursors = charts.map(cursorIn).filter((cursor) => cursor !== null);
  }

  /** Stand at a simulated time [s]. */
  place(time: number): void {
    for (const { line, origin, second, ends } of this.cursors) {
      const x = origin + time * second;
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
  const second = (to - from) / (late - early);
  if (!Number.isFinite(second)) return null;
  const line = document.createElementNS(SVG, "line");
  line.setAttribute("class", "film-cursor");
  line.setAttribute("y1", `${TOP}`);
  line.setAttribute("y2", `${chart.viewBox.baseVal.height - BOTTOM}`);
  chart.append(line);
  return { line, origin: from - early * second, second, ends: [from, to] };
}
