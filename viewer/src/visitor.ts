/** The person of a challenge: the sentence to agree to, the code, and the clock. */

import { agree, type Person } from "./talk.js";

/** From here on the clock also shows seconds [s]. */
const SECONDS_BELOW = 600;

export class VisitorCard {
  /** When the time ends, on the clock of the page [ms]; null without a limit. */
  private ends: number | null = null;

  /**
   * @param card - Asks for the consent.
   * @param clock - Shows the code and the time that is left.
   * @param say - Tells what is wrong.
   */
  constructor(
    private readonly card: HTMLElement,
    private readonly clock: HTMLElement,
    say: (sentence: string) => void,
  ) {
    const button = card.querySelector("button")!;
    button.addEventListener("click", () => {
      button.disabled = true;
      agree().catch((failure: unknown) => {
        button.disabled = false;
        say((failure as Error).message);
      });
    });
    setInterval(() => this.tick(), 1000);
  }

  /** Show a person, and whether they have still to agree. */
  show(person: Person, isOver: boolean): void {
    this.card.querySelector("p")!.textContent = person.consent;
    this.card.querySelector("#allowed")!.textContent = allowedInWords(person.minutes);
    this.card.hidden = person.agreed || isOver;
    this.ends = person.seconds_left === null ? null : performance.now() + 1000 * person.seconds_left;
    this.clock.dataset["code"] = `code ${person.code}`;
    this.clock.hidden = false;
    this.tick();
  }

  private tick(): void {
    const left = this.ends === null ? "" : ` · ${timeInWords(Math.max(0, (this.ends - performance.now()) / 1000))}`;
    const text = `${this.clock.dataset["code"] ?? ""}${left}`;
    if (this.clock.textContent !== text) this.clock.textContent = text;
  }
}

/** How much time there is, before the person agrees. */
function allowedInWords(minutes: number | null): string {
  if (minutes === null) return "There is no time limit.";
  const most = `${minutes} minute${minutes === 1 ? "" : "s"}`;
  return `You have ${most} for all scenes. The time starts when you agree, and runs on if you close this page.`;
}

function timeInWords(seconds: number): string {
  const whole = Math.ceil(seconds);
  if (whole > SECONDS_BELOW) return `${Math.ceil(whole / 60)} min left`;
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")} min left`;
}
