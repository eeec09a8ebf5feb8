import assert from "node:assert/strict";
import test from "node:test";
import { createIdleTimer } from "../../../static/study/state.js";

test("stillness is over after the protocol's seconds, and counted from the last touch", () => {
  let now = 0;
  const idle = createIdleTimer(() => now);
  now = 59_999;
  assert.equal(idle.isOver(60), false);
  now = 60_000;
  assert.equal(idle.isOver(60), true);
  idle.touch();
  assert.equal(idle.isOver(60), false);
});
