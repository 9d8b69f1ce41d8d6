/** Buttons at the calls of a notebook that show them in the film beside it, and the way back. */

import type { FilmCourse } from "./film_course.js";
import { element } from "./markup.js";

/** Adds a button to every call in the notebook of an entry while its film is open. */
export class FilmLinks {
  private readonly buttons: HTMLElement[] = [];

  constructor(
    private readonly entry: string,
    course: FilmCourse,
  ) {
    course.calls.forEach(({ turn, call }, index) => {
      const row = document.getElementById(this.row(turn, call));
      const place = row?.querySelector("code");
      if (!place) return;
      const name = `show call ${call + 1} of iteration ${turn + 1} in the film`;
      const button = element("button", { type: "button", class: "film-go", "aria-label": name, title: name }, "▶");
      button.dataset["call"] = `${index}`;
      place.before(button);
      this.buttons.push(button);
    });
  }

  /** A link to the call in the notebook. */
  back(turn: number, call: number): HTMLElement {
    return element("a", { href: `#${this.row(turn, Math.max(call, 0))}` }, "in the notebook");
  }

  remove(): void {
    for (const button of this.buttons) button.remove();
  }

  private row(turn: number, call: number): string {
    return `${this.entry}-${turn + 1}-${call + 1}`;
  }
}

/** The index of the call whose button an event comes from; null if it comes from anything else. */
export function callChosen(event: Event): number | null {
  const button = event.target instanceof Element ? event.target.closest<HTMLElement>("button.film-go") : null;
  return button ? Number(button.dataset["call"]) : null;
}
