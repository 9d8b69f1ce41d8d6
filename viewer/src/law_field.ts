/** The optional field for the law that a person states with the answer, in scenes whose `answer` has an argument `law`. */

import { element } from "./markup.js";

export class LawField {
  readonly element = element("details", { id: "law" });
  private readonly text = element("textarea", {
    name: "law",
    rows: "6",
    spellcheck: "false",
    autocapitalize: "off",
    "aria-label": "law, a JSON object",
    "aria-describedby": "law-said",
  });
  private readonly said = element("p", { class: "play-said", id: "law-said", role: "alert" });

  /**
   * @param description - What the tool says about the argument: the language of laws.
   * @param object - Id of an object, for the example.
   */
  constructor(description: string, object: string) {
    const law = { acceleration: { [object]: { x: `${object}_push_x/m - c*${object}_vx` } }, let: { m: 1.2, c: 0.4 } };
    this.text.placeholder = JSON.stringify(law, null, 1);
    this.element.append(
      element("summary", {}, "State the law (optional)"),
      this.text,
      this.said,
      element("details", {}, element("summary", {}, "How to write a law"), element("p", { class: "play-soft" }, description)),
    );
  }

  /** The law as it is typed; undefined if the field is empty. Throws a sentence if it is not a JSON object. */
  value(): unknown {
    const typed = this.text.value.trim();
    if (typed === "") return undefined;
    let law: unknown;
    try {
      law = JSON.parse(typed);
    } catch (fault) {
      throw new Error(`answer: law: it is not JSON: ${(fault as Error).message}`);
    }
    if (law === null || typeof law !== "object" || Array.isArray(law)) throw new Error("answer: law: it must be a JSON object");
    return law;
  }

  /** Tell why the law was refused; empty for nothing. What is typed stays. */
  tell(sentence: string): void {
    this.said.textContent = sentence;
    if (sentence !== "") this.element.open = true;
  }
}
