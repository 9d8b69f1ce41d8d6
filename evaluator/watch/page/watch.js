"use strict";
// Asks for the state of the run and shows it. Everything that an agent wrote is set as text.
(() => {
  const EVERY_MS = 2000, HIDDEN_MS = 20000;
  const byId = (id) => document.getElementById(id);
  const percent = (value) => (value === null ? "–" : `${(100 * value).toFixed(1)}\u00a0%`);
  const number = (value, digits = 3) => (value === null ? "–" : Number(value.toPrecision(digits)).toString());
  const count = (value) => (value === null ? "–" : value.toLocaleString("en"));

  function lasting(seconds) {
    const s = Math.round(seconds);
    return s < 120 ? `${s} s` : s < 7200 ? `${Math.round(s / 60)} min` : `${(s / 3600).toFixed(1)} h`;
  }

  function node(tag, text, name) {
    const made = document.createElement(tag);
    if (text !== undefined) made.textContent = text;
    if (name) made.className = name;
    return made;
  }

  // A row: its first cell names it, texts are left-aligned.
  function row(name, cells) {
    const made = node("tr"), head = node("th", name);
    head.scope = "row";
    made.append(head, ...cells.map((cell) => (cell instanceof Node ? cell : node("td", cell))));
    return made;
  }

  const named = (one) => `scene ${one.name}, seed ${one.seed}, ${one.agent}, budget ${one.budget}`
    + (one.epoch > 1 ? `, epoch ${one.epoch}` : "");

  function verdict(one) {
    const signs = { correct: "✓ correct", incorrect: "✗ incorrect", unscored: "– unscored" };
    const cell = node("td");
    cell.append(node("strong", signs[one.verdict] ?? "not graded", one.verdict ?? "soft"));
    if (one.outcome !== "answered") cell.append(` ${one.outcome.replaceAll("_", " ")}`);
    return cell;
  }

  function bar(one) {
    const cell = node("td", undefined, "bar");
    if (one.share === null) return cell;
    const space = "http://www.w3.org/2000/svg", svg = document.createElementNS(space, "svg");
    const draw = (tag, attributes) => {
      const made = document.createElementNS(space, tag);
      for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
      svg.append(made);
    };
    svg.setAttribute("viewBox", "0 0 100 10");
    svg.setAttribute("preserveAspectRatio", "none");
    svg.setAttribute("aria-hidden", "true");
    draw("line", { x1: 0, x2: 100, y1: 5, y2: 5 });
    draw("line", { class: "interval", x1: 100 * one.low, x2: 100 * one.high, y1: 5, y2: 5 });
    draw("ellipse", { cx: 100 * one.share, cy: 5, rx: 1.8, ry: 3.4 });
    cell.append(svg);
    return cell;
  }

  function condition(one) {
    const otherwise = Object.entries(one.outcomes).map(([name, n]) => `${n} ${name.replaceAll("_", " ")}`).join(", ");
    return row(one.agent, [
      String(one.budget), one.scored ? `${one.correct} of ${one.scored}` : "–", percent(one.share),
      one.low === null ? "–" : `${percent(one.low)} to ${percent(one.high)}`, bar(one), node("td", otherwise || "–", "text"),
      number(one.calls), percent(one.refused), number(one.lab_time_s), number(one.episode_s), count(one.tokens),
      one.cost_usd === null ? "–" : one.cost_usd.toFixed(2),
    ]);
  }

  // Accuracy so far, a line for each agent: it is told apart by its dashes and by its name at the end.
  function course(lines) {
    const space = "http://www.w3.org/2000/svg", [width, height, left, right, below] = [640, 190, 44, 150, 24];
    const svg = document.createElementNS(space, "svg");
    const draw = (tag, attributes, text) => {
      const made = document.createElementNS(space, tag);
      for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
      if (text !== undefined) made.textContent = text;
      svg.append(made);
    };
    const last = Math.max(1, ...lines.map((line) => line.points.at(-1)[0]));
    const x = (time) => left + (time / last) * (width - left - right), y = (share) => 8 + (1 - share) * (height - below - 8);
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    svg.setAttribute("role", "img");
    svg.setAttribute("aria-label", lines.map((line) => `${line.agent} ${percent(line.points.at(-1)[1])}`).join(", "));
    for (const share of [0, 0.5, 1]) {
      draw("line", { class: "axis", x1: left, x2: width - right, y1: y(share), y2: y(share) });
      draw("text", { x: left - 6, y: y(share) + 4, "text-anchor": "end" }, `${100 * share} %`);
    }
    draw("text", { x: width - right, y: height - 6, "text-anchor": "end" }, lasting(last));
    let free = 14;
    const ends = [...lines].sort((one, other) => other.points.at(-1)[1] - one.points.at(-1)[1]);
    ends.forEach((line, index) => {
      draw("polyline", { class: `course course-${index % 4}`, points: line.points.map(([t, share]) => `${x(t)},${y(share)}`).join(" ") });
      const at = Math.max(free, y(line.points.at(-1)[1]) + 4);
      free = at + 13;
      draw("text", { x: x(line.points.at(-1)[0]) + 6, y: at }, `${line.agent} ${percent(line.points.at(-1)[1])}`);
    });
    return svg;
  }

  function notebook(one) {
    const cell = node("td"), link = node("a", "open");
    if (one.verdict === null) return cell;
    link.href = `notebook?key=${encodeURIComponent(one.key)}`;
    link.setAttribute("aria-label", `notebook of ${named(one)}`);
    cell.append(link);
    return cell;
  }

  function phase(state) {
    if (state.behind) return `Reading the records: ${state.ended} episodes so far.`;
    const of = state.total === null ? "" : ` of ${state.total}`;
    const parts = [{ waiting: "No episode has ended yet.", finished: "All episodes have ended.",
      running: "Running.", quiet: `Quiet: no episode has ended for ${lasting(state.quiet_s ?? 0)}.` }[state.phase]];
    if (state.ended) parts.push(`${state.ended}${of} episodes.`);
    if (state.phase === "running" && state.per_minute) parts.push(`${number(state.per_minute)} a minute`
      + (state.left_s === null ? "." : `, about ${lasting(state.left_s)} left.`));
    if (state.withheld) parts.push("Its seeds are held back, so nothing is graded here.");
    return parts.join(" ");
  }

  function show(state) {
    if (state.phase === "absent") {
      byId("name").textContent = state.name;
      byId("phase").textContent = "No run has begun in this folder yet; the page waits for it.";
      return;
    }
    document.title = `${state.ended}${state.total === null ? "" : `/${state.total}`} ${state.name}`;
    byId("name").textContent = state.name;
    byId("shown").hidden = false;
    const told = phase(state);
    if (byId("phase").textContent !== told) byId("phase").textContent = told;
    byId("progress").hidden = state.total === null;
    byId("progress").value = state.total ? Math.min(1, state.ended / state.total) : 0;
    byId("notes").replaceChildren(...state.notes.map((note) => node("li", note)));
    byId("rows").replaceChildren(...state.rows.map(condition));
    byId("report").hidden = !state.report;
    byId("course").hidden = state.course.length === 0;
    byId("course").querySelector("svg")?.remove();
    if (state.course.length) byId("course").append(course(state.course));
    byId("running").replaceChildren(...state.running.map((one) => row(named(one), [
      one.turn ? `${one.turn} of ${one.budget}` : "–", node("td", one.call || "–", "text"), lasting(one.seconds)])));
    for (const name of ["running", "overtaken", "troubled"]) byId(`${name}-part`).hidden = state[name].length === 0;
    byId("overtaken").replaceChildren(...state.overtaken.map((one) => row(named(one), [String(one.by), lasting(one.since_s)])));
    byId("troubled").replaceChildren(...state.troubled.map((one) => row(named(one), [
      one.outcome.replaceAll("_", " "), `${one.refused} of ${one.calls}`,
      node("td", one.error || "most calls were refused", "text")])));
    byId("newest").replaceChildren(...state.newest.map((one) => row(named(one), [
      verdict(one), node("td", one.answer, "text"), String(one.turns), String(one.calls), number(one.lab_time_s),
      one.duration_s.toFixed(1), notebook(one)])));
  }

  async function ask() {
    let wait = document.hidden ? HIDDEN_MS : EVERY_MS;
    try {
      const reply = await fetch("state.json"), state = await reply.json();
      if (reply.ok) show(state);
      else byId("phase").textContent = state.error;
      if (state.phase === "finished") wait = HIDDEN_MS;
      if (state.behind) wait = 0;
    } catch {
      byId("phase").textContent = "physment-eval watch has ended; what is shown was its last state.";
    }
    setTimeout(ask, wait);
  }

  ask();
})();
