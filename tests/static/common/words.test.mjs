import assert from "node:assert/strict";
import test from "node:test";
import * as words from "../../../static/common/words.js";

const frame = (changes = {}) => ({ episode: "e", step: 60, rows: 3, cols: 4, grid: ["@.?#", "#.??", "????"], position: [0, 0], coverage: 0.5,
  score: 0.9, outcome: null, ...changes });

test("coverage never reads 99.0 before 99 % are known", () => {
  assert.equal(words.percent(0.98999), "98.9");
  assert.equal(words.percent(0.99), "99.0");
  assert.equal(words.percent(1), "100.0");
});

test("the comparison says who needed fewer moves", () => {
  const mine = frame({ outcome: "explored" });
  assert.equal(words.compare(mine, frame({ outcome: "explored", step: 70 }), "ppo"), "You needed 10 moves fewer than ppo (70, score 0.900).");
  assert.equal(words.compare(mine, frame({ outcome: "explored", step: 59 }), "ppo"), "You needed 1 move more than ppo (59, score 0.900).");
  assert.equal(words.compare(mine, frame({ outcome: "explored" }), "ppo"), "You and ppo both needed 60 moves.");
  assert.match(words.compare(mine, frame(), "ppo"), /still exploring: 60 moves, 50.0 %/);
  assert.match(words.compare(mine, frame({ outcome: "timed_out" }), "ppo"), /did not reach 99 %: out of moves/);
  assert.equal(words.compare(mine, null, "ppo"), "");
});

test("only an explored terrain has steps to 99 %", () => {
  assert.equal(words.stepsToGoal(frame({ outcome: "explored" })), 60);
  assert.equal(words.stepsToGoal(frame({ outcome: "timed_out" })), null);
});

test("the matrix in words names the four neighbours, edges too", () => {
  const said = words.describeBoard(frame(), "You");
  assert.match(said, /3 rows, 4 columns/);
  assert.match(said, /north edge, east free, south obstacle, west edge/);
});

test("a screen reader hears tenths, endings and new terrains, not every step", () => {
  assert.equal(words.announcement(frame({ coverage: 0.41 }), frame({ coverage: 0.44 })), "");
  assert.match(words.announcement(frame({ coverage: 0.39 }), frame({ coverage: 0.44 })), /^40 percent/);
  assert.match(words.announcement(frame(), frame({ outcome: "collided" })), /score 0.900/);
  assert.match(words.announcement(null, frame()), /^New terrain/);
});

test("the human level of a configuration is one short line", () => {
  assert.equal(words.figure({ score: { mean: 0.9391 }, steps: { mean: 81.23 } }), "81.2 steps \u00b7 score 0.939");
});
