import assert from "node:assert/strict";
import test from "node:test";
import { assign, readKeys } from "../../../static/common/keymap.js";
import { readChoices, readPalette } from "../../../static/study/settings.js";
import { taskOf } from "../../../static/task/mars/index.js";
import { MARS } from "../task/mars/about.mjs";

const { keys: DEFAULT_KEYS } = taskOf(MARS);

test("kept keys and colours are whole or none", () => {
  assert.deepEqual(readKeys(null, DEFAULT_KEYS), { ...DEFAULT_KEYS });
  assert.deepEqual(readKeys({ ...DEFAULT_KEYS, north: ["KeyS", "KeyW"] }, DEFAULT_KEYS), { ...DEFAULT_KEYS });
  const keys = assign(DEFAULT_KEYS, "west", 0, "KeyJ");
  assert.deepEqual(readKeys(JSON.parse(JSON.stringify(keys)), DEFAULT_KEYS), keys);
  const game = { fire: ["Space"], left: ["KeyA"] };
  assert.deepEqual(readKeys({ fire: ["KeyB"], left: ["Space"] }, game), { fire: ["KeyB"], left: ["Space"] });
  assert.deepEqual(readKeys({ fire: ["Space"], left: ["Tab"] }, game), game);
  assert.equal(readPalette("pink", false), "standard");
  assert.equal(readPalette(undefined, true), "high-contrast");
  assert.equal(readPalette("constructor", false), "standard");
  assert.deepEqual(readChoices({ pad: false, palette: "colour-blind" }, { wantsContrast: true, isTouch: true, keys: DEFAULT_KEYS }),
    { modality: "touch", palette: "colour-blind", keys: { ...DEFAULT_KEYS }, pad: false });
});
