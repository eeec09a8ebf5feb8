import assert from "node:assert/strict";
import test from "node:test";
import { actionOf } from "../../../static/common/keyboard.js";
import { keyName } from "../../../static/common/task.js";
import { taskOf } from "../../../static/task/mars/index.js";
import { MARS } from "../task/mars/about.mjs";
import { assign, mayDrive, ownCode } from "../../../static/common/keymap.js";

const { keys: DEFAULT_KEYS } = taskOf(MARS);

test("a key drives in one direction: one that is taken changes places", () => {
  assert.equal(actionOf(DEFAULT_KEYS, "KeyW"), "north");
  assert.equal(actionOf(DEFAULT_KEYS, "KeyQ"), undefined);
  const keys = assign(DEFAULT_KEYS, "north", 1, "KeyI");
  assert.deepEqual(keys.north, ["ArrowUp", "KeyI"]);
  const swapped = assign(DEFAULT_KEYS, "north", 0, "KeyD");
  assert.deepEqual([swapped.north[0], swapped.east[1]], ["KeyD", "ArrowUp"]);
  assert.equal(new Set(Object.values(swapped).flat()).size, 8);
  for (const code of ["Tab", "Enter", "Escape", "Space", "ShiftLeft", "F5", "NumpadEnter"]) {
    assert.equal(mayDrive(code), false);
    assert.equal(typeof assign(DEFAULT_KEYS, "north", 0, code), "string");
  }
});

test("a key that was chosen counts as the one in whose place it drives, and that one no more", () => {
  const keys = assign(DEFAULT_KEYS, "north", 1, "KeyI");
  assert.deepEqual(["KeyI", "ArrowUp", "KeyW"].map((code) => ownCode(keys, DEFAULT_KEYS, code)), ["KeyW", "ArrowUp", undefined]);
});

test("a key is called what is printed on it", () => {
  assert.equal(keyName("ArrowUp"), "\u2191");
  assert.equal(keyName("KeyQ"), "Q");
  assert.equal(keyName("KeyQ", new Map([["KeyQ", "a"]])), "A");
  assert.equal(keyName("Numpad8"), "Num 8");
});
