/** The app of the laboratory in a chat: shows the result of a tool as a client of MCP Apps passes it on. */

import {
  App,
  applyDocumentTheme,
  applyHostStyleVariables,
  type McpUiHostContext,
} from "@modelcontextprotocol/ext-apps";

import { asView, type View, viewIn } from "./drawing.js";
import { element } from "./markup.js";
import { LabPanel } from "./panel.js";

type Result = Parameters<NonNullable<App["ontoolresult"]>>[0];

const VIEW_URI = "physment://view";
const prefersDark = matchMedia("(prefers-color-scheme: dark)");
const reducedMotion = matchMedia("(prefers-reduced-motion: reduce)").matches;
const root = document.getElementById("lab")!;
const panel = new LabPanel(root, { dark: prefersDark.matches, reducedMotion });
const app = new App({ name: "physment-lab", title: "PhysMent laboratory", version: "1.0.0" }, {});

/** Use the colours of the client as far as it tells them. */
function dress(context: Partial<McpUiHostContext> | undefined): void {
  const dark = (context?.theme ?? (prefersDark.matches ? "dark" : "light")) === "dark";
  applyDocumentTheme(dark ? "dark" : "light");
  if (context?.styles?.variables) applyHostStyleVariables(context.styles.variables);
  panel.setDark(dark);
}

let wasShown = false;

async function show(result: Result): Promise<void> {
  wasShown = true;
  const view = viewIn(result._meta) ?? (await viewNow());
  if (view) panel.show(view);
  const text = result.content.find((part) => part.type === "text")?.text ?? "";
  if (result.isError) panel.say(text);
  else if (!view) panel.say("This client passed on no view of the laboratory; the result itself is complete.");
  const image = result.content.find((part) => part.type === "image");
  if (panel.flat && image) {
    root.prepend(
      element("img", { class: "lab-still", alt: "the scene", src: `data:${image.mimeType};base64,${image.data}` }),
    );
  }
  requestAnimationFrame(() => requestAnimationFrame(() => tell(view)));
}

/** What may be seen now: after a refused call, or if the client took `_meta` away. Reading it is no call. */
async function viewNow(): Promise<View | null> {
  if (!app.getHostCapabilities()?.serverResources) return null;
  try {
    const [content] = (await app.readServerResource({ uri: VIEW_URI })).contents;
    return content && "text" in content ? asView(JSON.parse(content.text)) : null;
  } catch {
    return null;
  }
}

/** Tell a client that keeps logs how long the first picture took. */
function tell(view: View | null): void {
  if (!app.getHostCapabilities()?.logging) return;
  const data = {
    drawn: view?.drawing.bodies.length ?? 0,
    flat: panel.flat,
    firstPictureMs: panel.picture.firstPictureMs,
  };
  void app.sendLog({ level: "debug", logger: "physment-lab", data });
}

app.ontoolresult = (result) => void show(result);
app.ontoolcancelled = () => panel.say("The call was taken back; it changed nothing.");
app.onhostcontextchanged = (context) => dress({ ...app.getHostContext(), ...context });
app.onteardown = () => {
  panel.playback?.pause();
  panel.picture.dispose();
  return {};
};
prefersDark.addEventListener("change", () => dress(app.getHostContext()));
dress(undefined);
await app.connect();
dress(app.getHostContext());
// The scene is seen as soon as the app opens; a result that came meanwhile is newer.
const atOpening = await viewNow();
if (atOpening && !wasShown) panel.show(atOpening, false);
