/** What the page of a person who plays exchanges with the command that serves it. */

import type { View } from "./drawing.js";

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

export interface Scene {
  objects?: { object_id: string; name: string }[];
  disabled_tools?: string[];
  answer?: { kind?: string; unit?: string | string[] | null; labels?: string[]; options?: string[] } | null;
}

export interface State {
  version: number;
  waiting: boolean;
  prompt?: string;
  budget?: number;
  left: number;
  tools: Tool[];
  scene: Scene;
  turns: { note: string; exchanges: Exchange[] }[];
  view: View | null;
  ended: string | null;
}

/** The number of this window, the same after it is loaded again. */
const page = sessionStorage.getItem("page") ?? crypto.randomUUID();
sessionStorage.setItem("page", page);

async function ask(path: string, options: RequestInit = {}): Promise<Response> {
  const reply = await fetch(path, { ...options, headers: { "x-physment-page": page } });
  if (reply.ok) return reply;
  const { error } = (await reply.json()) as { error?: string };
  throw new Error(error ?? `the command answered ${reply.status}`);
}

/** The state, as soon as it is newer than a version. */
export async function stateAfter(version: number): Promise<State> {
  return (await (await ask(`state?after=${version}`)).json()) as State;
}

/** Make the calls of an iteration; throws the sentence of a refusal. */
export async function take(calls: Call[], note: string): Promise<void> {
  await ask("turn", { method: "POST", body: JSON.stringify({ calls, note }) });
}

/** Leave without an answer. */
export async function leave(): Promise<void> {
  await ask("leave", { method: "POST" });
}
