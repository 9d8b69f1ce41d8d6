/** The card at the end of an episode: the verdict, the key, the report, and what can be played next. */

import { element } from "./markup.js";
import { shortened } from "./readings.js";
import { close, playNext, type State } from "./talk.js";

/**
 * The content of the card.
 *
 * @param state - An episode that is over.
 * @param say - Tells what is wrong.
 */
export function endCard({ ended, end, scene, person }: State, say: (sentence: string) => void): HTMLElement[] {
  const unit = typeof scene.answer?.unit === "string" && scene.answer.unit !== "1" ? ` ${scene.answer.unit}` : "";
  const mark = end?.correct === true ? "✓ " : end?.correct === false ? "✗ " : "";
  const shown: HTMLElement[] = [element("h2", {}, `${mark}${ended ?? ""}`)];
  if (end && end.key !== null) {
    const rows = [
      ["Key", `${shortened(end.key)}${unit}`],
      ["Your answer", end.answer === null ? "none" : `${shortened(end.answer)}${unit}`],
    ];
    shown.push(element("dl", {}, ...rows.flatMap(([name, value]) => [element("dt", {}, name!), element("dd", {}, value!)])));
  }
  const buttons: HTMLElement[] = Object.entries(end?.choices ?? {}).map(([choice, name]) =>
    action(`Play ${name}`, () => playNext(choice), say),
  );
  if (end?.report) buttons.unshift(element("a", { href: "report", target: "_blank", rel: "noopener" }, "Report"));
  if (!person) buttons.push(action("Close the laboratory", close, say));
  shown.push(element("p", { class: "play-buttons" }, ...buttons));
  return shown;
}

function action(text: string, act: () => Promise<void>, say: (sentence: string) => void): HTMLButtonElement {
  const button = element("button", { type: "button" }, text);
  button.addEventListener("click", () => {
    button.disabled = true;
    act().catch((failure: unknown) => {
      button.disabled = false;
      say((failure as Error).message);
    });
  });
  return button;
}
