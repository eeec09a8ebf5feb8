import assert from "node:assert/strict";
import test from "node:test";
import { challengerText } from "../../../static/challenge/words.js";

test("a challenge says who has taken it up", () => {
  assert.deepEqual([{ name: null, moves: 79 }, { name: "Ada", moves: 1 }].map(challengerText), ["79 moves, by somebody", "1 move, by Ada"]);
});
