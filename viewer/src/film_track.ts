/** The slider of a film, with a tick at each call: a long one where a turn begins. */

import type { FilmCourse } from "./film_course.js";
import { element } from "./markup.js";

const SVG = "http://www.w3.org/2000/svg";
const WIDTH = 1000;

/** A slider over the time of a film, and its ticks. */
export function trackOf(course: FilmCourse, scrub: HTMLInputElement): HTMLElement {
  scrub.min = `${course.start}`;
  scrub.max = `${course.end}`;
  scrub.disabled = course.end <= course.start;
  const ticks = document.createElementNS(SVG, "svg");
  ticks.setAttribute("viewBox", `0 0 ${WIDTH} 8`);
  ticks.setAttribute("preserveAspectRatio", "none");
  ticks.setAttribute("aria-hidden", "true");
  const drawn = { long: new Set<number>(), short: new Set<number>() };
  for (const { call, instant } of course.calls) {
    const share = ((course.reel.times[instant] ?? 0) - course.start) / (course.end - course.start || 1);
    (call === 0 ? drawn.long : drawn.short).add(Math.round(share * WIDTH));
  }
  const path = document.createElementNS(SVG, "path");
  const lines = [...drawn.long].map((at) => `M${at} 0V8`);
  lines.push(...[...drawn.short].filter((at) => !drawn.long.has(at)).map((at) => `M${at} 0V4`));
  path.setAttribute("d", lines.join(""));
  ticks.append(path);
  return element("div", { class: "film-track" }, scrub, ticks);
}
