// Builds the pages of the viewer, each one file without any address, and puts them where the packages have them.
// `node build.mjs` writes them; `node build.mjs DIR` writes them into a folder, to be compared.
import { createHash } from "node:crypto";
import { mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

import { build } from "esbuild";

const HERE = dirname(fileURLToPath(import.meta.url));
const PAGES = [
  { source: "app", target: "physment_mcp/serving/lab.html" },
  // Talks to the command that serves it.
  { source: "play", target: "evaluator/agents/browser/play.html", connects: "connect-src 'self'; " },
  // The same, and shows the app in a frame.
  {
    source: "preview",
    target: "physment_mcp/commands/preview.html",
    connects: "connect-src 'self'; frame-src 'self'; ",
  },
];
const SCRIPTS = [{ source: "film", target: "evaluator/report/film.js" }];

/** Leaves out the translations of zod's messages, a fifth of the page, which nobody reads. */
const english = {
  name: "english",
  setup(bundling) {
    bundling.onLoad({ filter: /zod\/v4\/locales\/index\.js$/ }, () => ({
      contents: 'export { default as en } from "./en.js";',
    }));
  },
};

/** The bundled text of a script or a style sheet. */
async function bundle(entry, options = {}) {
  const done = await build({
    entryPoints: [join(HERE, "src", entry)],
    bundle: true,
    minify: true,
    format: "esm",
    target: "es2022",
    charset: "utf8",
    legalComments: "none",
    plugins: [english],
    write: false,
    logLevel: "warning",
    ...options,
  });
  // A script ends at the first closing tag, also inside a text of it.
  return done.outputFiles[0].text.trim().replaceAll("</script", "<\\/script");
}

function hash(text) {
  return `'sha256-${createHash("sha256").update(text).digest("base64")}'`;
}

/** A page in one file: only its own script and its own style run in it, and nothing is loaded. */
async function page(source, connects = "") {
  const [script, style] = await Promise.all([bundle(`${source}.ts`), bundle(`${source}.css`)]);
  const policy = `default-src 'none'; ${connects}script-src ${hash(script)}; style-src ${hash(style)}; img-src data:; base-uri 'none'`;
  const parts = { policy, style: `<style>${style}</style>`, script: `<script type="module">${script}</script>` };
  const template = readFileSync(join(HERE, "src", `${source}.html`), "utf8");
  return template.replace(/{{(\w+)}}/g, (_, name) => parts[name]);
}

/** A classic script with its own style: what a page that was opened from disk may load. */
async function script(source) {
  const style = await bundle(`${source}.css`);
  return `${await bundle(`${source}.ts`, { format: "iife", define: { FILM_STYLE: JSON.stringify(style) } })}\n`;
}

const [folder] = process.argv.slice(2);
const built = [...PAGES.map((one) => ({ ...one, make: page })), ...SCRIPTS.map((one) => ({ ...one, make: script }))];
for (const { source, target, connects, make } of built) {
  const file = folder === undefined ? join(HERE, "..", target) : join(folder, target);
  mkdirSync(dirname(file), { recursive: true });
  const text = await make(source, connects);
  writeFileSync(file, text);
  console.log(`${target} ${Math.round(Buffer.byteLength(text) / 1000)} kB`);
}
