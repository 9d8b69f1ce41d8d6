/** A page that shows the app as a chat client does: in a frame of its own, by the official bridge. */

import { AppBridge, PostMessageTransport } from "@modelcontextprotocol/ext-apps/app-bridge";

import { ToolForm } from "./form.js";
import { rendered } from "./markdown.js";
import { element } from "./markup.js";
import { callInWords, type Known, namesOf, toolInWords, wireName } from "./plain.js";
import type { Call, Tool } from "./talk.js";

type Result = Parameters<AppBridge["sendToolResult"]>[0];

interface Shown {
  title: string;
  prompt: string;
  tools: Tool[];
  /** Tools whose results go to the app. */
  showing: string[];
}

const dark = matchMedia("(prefers-color-scheme: dark)");
const by = (id: string) => document.getElementById(id)!;
const tools = by("tool") as HTMLSelectElement;
const run = by("run") as HTMLButtonElement;
const shown = (await (await fetch("state")).json()) as Shown;
let form: ToolForm | null = null;

/** Objects of the task: the first column of its table. */
function objects(): Known[] {
  const rows = [...shown.prompt.matchAll(/^\| (object_\d+) \| ([^|]*) \|/gm)];
  return rows.map(([, id, name]) => ({ id: id!, name: name!.trim() }));
}

function theme(): "light" | "dark" {
  const name = dark.matches ? "dark" : "light";
  document.documentElement.dataset["theme"] = name;
  return name;
}

/** Open the app in a frame that may run scripts and nothing else of this page. */
async function open(): Promise<AppBridge> {
  const frame = element("iframe", { sandbox: "allow-scripts", title: "The laboratory" });
  const capabilities = { logging: {}, serverResources: {} };
  const info = { name: "physment-preview", version: "1" };
  const bridge = new AppBridge(null, info, capabilities, { hostContext: { theme: theme() } });
  bridge.onsizechange = ({ height }) => {
    if (height !== undefined) frame.style.height = `${height}px`;
  };
  bridge.onreadresource = async ({ uri }) => {
    const { text } = (await (await fetch("view")).json()) as { text: string };
    return { contents: [{ uri, mimeType: "application/json", text }] };
  };
  const ready = new Promise<void>((resolve) => {
    bridge.oninitialized = () => resolve();
  });
  by("app").append(frame);
  await bridge.connect(new PostMessageTransport(frame.contentWindow!, frame.contentWindow!));
  frame.src = "app";
  await ready;
  return bridge;
}

function showForm(): void {
  const tool = shown.tools.find((one) => one.name === tools.value);
  if (!tool) return;
  form = new ToolForm(tool, objects());
  by("form").replaceChildren(form.element);
}

async function call(bridge: AppBridge, made: Call): Promise<void> {
  const reply = await fetch("call", { method: "POST", body: JSON.stringify(made) });
  const result = (await reply.json()) as Result;
  const text = result.content.find((part) => part.type === "text")?.text ?? "";
  const mark = result.isError ? "✗ refused: " : "";
  by("calls").append(element("li", {}, element("b", {}, callInWords(made, namesOf(objects()))), ...wireName(made.tool, ""), element("br"), element("code", {}, mark + text)));
  if (!shown.showing.includes(made.tool)) return;
  await bridge.sendToolInput({ arguments: made.arguments });
  await bridge.sendToolResult(result);
}

by("title").textContent = `${shown.title} · preview`;
by("prompt").replaceChildren(...rendered(shown.prompt));
tools.append(...shown.tools.map(({ name }) => element("option", { value: name }, `${toolInWords(name)} · ${name}`)));
tools.addEventListener("change", showForm);
theme();
showForm();
const bridge = await open();
run.disabled = false;
dark.addEventListener("change", () => bridge.setHostContext({ theme: theme() }));
by("turn").addEventListener("submit", (event) => {
  event.preventDefault();
  by("said").textContent = "";
  run.disabled = true;
  Promise.resolve()
    .then(() => call(bridge, form!.call()))
    .catch((failure: unknown) => void (by("said").textContent = (failure as Error).message))
    .finally(() => (run.disabled = false));
});
