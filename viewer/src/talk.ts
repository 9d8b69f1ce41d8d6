/** What the page of a person who plays exchanges with the command that serves it. */

import type { Readings, View } from "./drawing.js";

export interface Schema {
  type?: string;
  anyOf?: Schema[];
  items?: Schema;
  minItems?: number;
  maxItems?: number;
  minimum?: number;
  maximum?: number;
  exclusiveMinimum?: number;
  enum?: string[];
  default?: unknown;
  description?: string;
}

export interface Tool {
  name: string;
  description: string;
  input_schema: { properties?: Record<string, Schema>; required?: string[] };
}

export interface Call {
  tool: string;
  arguments: Record<string, unknown>;
}

export interface Exchange extends Call {
  returned: boolean;
  is_error: boolean;
  content: Record<string, unknown> | null;
  text: string;
}

/** Bounds of the episode, as the prompt states them; one that is absent has the default of every laboratory. */
export interface Limits {
  /** [N] */
  force?: number;
  /** [N·m] */
  torque?: number;
  /** [kg] */
  created_mass?: number;
  /** [s] */
  lab_time?: number;
  calls?: number;
}

export interface AnswerForm {
  kind?: string;
  unit?: string | string[] | null;
  labels?: string[];
  options?: string[];
}

/** What is told once the episode is over. */
export interface End {
  /** null if nothing was recorded. */
  correct: boolean | null;
  key: unknown;
  answer: unknown;
  report: boolean;
  /** What can be played next, and its name. */
  choices: Record<string, string>;
}

export interface Scene {
  scene_id?: number;
  name?: string;
  task?: string;
  objects?: { object_id: string; name: string }[];
  disabled_tools?: string[];
  answer?: AnswerForm | null;
}

/** Who takes part in a challenge. */
export interface Person {
  code: string;
  consent: string;
  agreed: boolean;
  /** Time from the consent on [min]; null without a limit. */
  minutes: number | null;
  /** null without a limit, and before the consent. */
  seconds_left: number | null;
}

export interface State {
  /** Absent outside of challenges. */
  person?: Person;
  version: number;
  /** Number of the episode on this page. */
  number: number;
  waiting: boolean;
  rules: { limits?: Limits; steps?: { name: string; meaning: string; unit: string }[] };
  prompt?: string;
  budget?: number;
  left: number;
  tools: Tool[];
  scene: Scene;
  turns: { note: string; exchanges: Exchange[] }[];
  view: View | null;
  /** Last readings of the places of objects. */
  read: Readings;
  ended: string | null;
  end: End | null;
}

/** Another window plays this episode. */
export class Elsewhere extends Error {}

/** The number of this window, the same after it is loaded again. */
const page = sessionStorage.getItem("page") ?? crypto.randomUUID();
sessionStorage.setItem("page", page);

async function ask(path: string, options: RequestInit = {}): Promise<Response> {
  const reply = await fetch(path, { ...options, headers: { "x-physment-page": page } });
  if (reply.ok) return reply;
  const { error } = (await reply.json()) as { error?: string };
  const said = error ?? `the command answered ${reply.status}`;
  throw said.includes("another window") ? new Elsewhere(said) : new Error(said);
}

/** The state, as soon as it is newer than a version. */
export async function stateAfter(version: number): Promise<State> {
  return (await (await ask(`state?after=${version}`)).json()) as State;
}

/** Make the calls of an iteration; throws the sentence of a refusal. */
export async function take(calls: Call[], note: string): Promise<void> {
  await ask("turn", { method: "POST", body: JSON.stringify({ calls, note }) });
}

/** Agree to take part in a challenge. */
export async function agree(): Promise<void> {
  await ask("agree", { method: "POST" });
}

/** Leave without an answer; the episode ends. */
export async function leave(): Promise<void> {
  await ask("leave", { method: "POST" });
}

/** Play on after the end: one of its choices. */
export async function playNext(choice: string): Promise<void> {
  await ask(`next?play=${choice}`, { method: "POST" });
}

/** End the command. */
export async function close(): Promise<void> {
  await ask("close", { method: "POST" });
}

/** Make this window the one that plays. */
export async function takeOver(): Promise<void> {
  await ask("take-over", { method: "POST" });
}
