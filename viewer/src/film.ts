/**
 * Plays the films of a report: one classic script, which its page loads when the first film is opened. A page on disk
 * may load scripts and nothing else, so each film is a script as well, which calls `physmentFilm`.
 */

import { FilmPlayer } from "./film_player.js";
import { element } from "./markup.js";
import { type Film, Reel } from "./reel.js";

declare const FILM_STYLE: string;
declare global {
  interface Window {
    physmentFilm: (film: Film) => void;
    physmentShowFilm: (place: HTMLElement) => void;
  }
}

const AGAIN = "make it again with physment-eval film, and then the report.";
const waiting = new Map<Element | null, (film: Film) => void>();
let open: FilmPlayer | null = null;

document.head.append(element("style", {}, FILM_STYLE));
window.physmentFilm = (film) => waiting.get(document.currentScript)?.(film);

/** Load the film of a place in a notebook, and show it there. */
window.physmentShowFilm = (place) => {
  const { film: address = "", episode = "" } = place.dataset;
  const script = element("script", { src: address });
  waiting.set(script, (film) => {
    if (film.format !== 1) say(place, `This film was made by another version of this program; ${AGAIN}`);
    else if (film.episode !== episode) say(place, `This film shows another record of this episode; ${AGAIN}`);
    else show(place, film);
  });
  script.addEventListener("error", () => say(place, `The film is missing: ${address} belongs beside this page.`));
  script.addEventListener("load", () => script.remove());
  document.head.append(script);
};

function show(place: HTMLElement, film: Film): void {
  open?.close();
  try {
    open = new FilmPlayer(place, new Reel(film));
  } catch (error) {
    say(place, `This film is damaged (${error instanceof Error ? error.message : String(error)}); ${AGAIN}`);
  }
}

function say(place: HTMLElement, sentence: string): void {
  place.querySelector(".film-said")?.remove();
  place.append(element("p", { class: "film-said flag", role: "status" }, sentence));
}
