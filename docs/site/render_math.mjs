// Formulas as JSON on standard input, [{tex, display}], become a JSON list of HTML. Argument: KaTeX's module.
import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const { default: katex } = await import(pathToFileURL(process.argv[2]).href);
const out = [];
for (const { tex, display } of JSON.parse(readFileSync(0, "utf8"))) {
  try {
    out.push(katex.renderToString(tex, { displayMode: display, throwOnError: true, strict: "error" }));
  } catch (error) {
    console.error(`${tex}: ${error.message}`);
    process.exit(1);
  }
}
process.stdout.write(JSON.stringify(out));
