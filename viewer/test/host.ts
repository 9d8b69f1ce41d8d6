/** A page that hosts the app as a chat client does, by the official bridge; for tests. */

import { AppBridge, PostMessageTransport } from "@modelcontextprotocol/ext-apps/app-bridge";

type Result = Parameters<AppBridge["sendToolResult"]>[0];

declare global {
  interface Window {
    host: typeof host;
  }
}

/** What the app logged, and what it asked for. */
const said: unknown[] = [];
let bridge: AppBridge | null = null;

const host = {
  said,

  /** Open the app in a frame, as a client does: scripts, and nothing else of this page. */
  async open(page: string, theme: "light" | "dark", view: string | null): Promise<void> {
    const frame = document.createElement("iframe");
    frame.setAttribute("sandbox", "allow-scripts");
    frame.style.cssText = "width:100%;height:600px;border:0";
    const capabilities = { logging: {}, ...(view === null ? {} : { serverResources: {} }) };
    bridge = new AppBridge(null, { name: "test-host", version: "1" }, capabilities, { hostContext: { theme } });
    bridge.onloggingmessage = ({ data }) => said.push(data);
    bridge.onsizechange = ({ height }) => {
      if (height !== undefined) frame.style.height = `${height}px`;
    };
    bridge.onreadresource = async ({ uri }) => {
      said.push({ read: uri });
      return { contents: [{ uri, mimeType: "application/json", text: view ?? "" }] };
    };
    const ready = new Promise<void>((resolve) => {
      bridge!.oninitialized = () => resolve();
    });
    document.body.replaceChildren(frame);
    const target = frame.contentWindow!;
    await bridge.connect(new PostMessageTransport(target, target));
    frame.srcdoc = page;
    await ready;
  },

  async give(result: Result): Promise<void> {
    await bridge!.sendToolInput({ arguments: {} });
    await bridge!.sendToolResult(result);
  },

  dress(theme: "light" | "dark"): void {
    bridge!.setHostContext({ theme });
  },
};
window.host = host;
