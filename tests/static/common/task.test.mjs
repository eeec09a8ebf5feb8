import assert from "node:assert/strict";
import test from "node:test";
import { promptText } from "../../../static/common/task.js";
import { MARS } from "../task/mars/about.mjs";

test("the first move is asked for by what a task has: a swipe stands for an arrow key", () => {
  const doors = { left: ["ArrowLeft"], open: ["Space"] };
  const letters = { hit: ["KeyH"], stand: ["KeyS"] };
  const asked = (isTouch) => [MARS.keys, doors, letters].map((keys) => promptText(isTouch, keys, keys));
  assert.deepEqual(asked(true), ["Swipe or tap an arrow", "Swipe or tap a button", "Tap a button"]);
  assert.deepEqual(asked(false), ["Press an arrow key", "Press one of your keys", "Press one of your keys"]);
});
