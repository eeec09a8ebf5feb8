import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import test from "node:test";

const PAGE = `
  const texts = { textContent: JSON.stringify({ "link.busy": "Sp\u00e4ter." }) };
  globalThis.document = { documentElement: { lang: "de" }, querySelector: (selector) => (selector === "#texts" ? texts : null) };
  const { readDetail } = await import(process.argv[1]);
  console.log(JSON.stringify([429, 507, 422].map((status) => readDetail("at most 5 boards", status))));
`;

test("a page in another language has a sentence of its own for the limits, whose own are in English", () => {
  // a page's language is read once, so this one has a process of its own
  const { stdout, stderr } = spawnSync(process.execPath, ["--input-type=module", "-e", PAGE, new URL("../../../static/common/api.js", import.meta.url).href], { encoding: "utf8" });
  assert.deepEqual(JSON.parse(stdout || JSON.stringify(stderr)), ["Sp\u00e4ter.", "Sp\u00e4ter.", "at most 5 boards"]);
});
