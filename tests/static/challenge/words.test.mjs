import assert from "node:assert/strict";
import test from "node:test";
import { challengerText, headline } from "../../../static/challenge/words.js";

const task = { successes: ["explored"], round: "terrain" };

test("a challenge says what is to be beaten, and who did", () => {
  assert.equal(headline(task, { outcome: "explored", actions: Array(85).fill("east") }), "85 moves. Beat it.");
  assert.equal(headline(task, { outcome: "explored", actions: ["east"] }), "1 move. Beat it.");
  assert.equal(headline(task, { outcome: "collided", actions: ["east"] }), "This terrain was not finished. Finish it.");
  assert.deepEqual([{ name: null, moves: 79 }, { name: "Ada", moves: 1 }].map(challengerText), ["79 moves, by somebody", "1 move, by Ada"]);
});
