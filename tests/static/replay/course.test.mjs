// The course of an episode, move by move: what was known, where the rover was, and where it crashed.
import assert from "node:assert/strict";
import test from "node:test";
import { boardAt, coverageAt, crashAt, hasEnded, newCells } from "../../../static/replay/course.js";

/** Two moves east on 2 x 3 cells, then into the rock in the corner. */
const course = {
  name: "ppo", actions: ["east", "south", "east"], positions: [[0, 0], [0, 1], [1, 1], [1, 1]], discovered: [2, 4, 5, 5], cells: 6,
  grid: ["...", ".?#"].map((line, row) => (row ? "..#" : line)), known_since: [[0, 0, 1], [1, -1, 2]], outcome: "collided", score: 0.2, sentence: "crashed",
};

test("the board after some moves shows what was known then and nothing else", () => {
  assert.deepEqual(boardAt(course, 0).frame.grid, ["..?", "???"]);
  assert.deepEqual(boardAt(course, 1).frame.grid, ["...", ".??"]);
  assert.deepEqual(boardAt(course, 2).frame.grid, ["...", ".?#"], "a cell that was never known stays dark");
  assert.deepEqual(boardAt(course, 1).trail, [[0, 0], [0, 1]]);
  assert.equal(boardAt(course, 0).frame.heading, "east");
  assert.equal(boardAt(course, 2).frame.heading, "south");
});

test("a run that has ended stays at its end", () => {
  const { frame, trail } = boardAt(course, 99);
  assert.deepEqual([frame.step, frame.outcome, trail.length], [3, "collided", 4]);
  assert.equal(boardAt(course, 2).frame.outcome, null);
  assert.deepEqual([2, 3, 4].map((step) => hasEnded(course, step)), [false, true, true]);
  assert.equal(coverageAt(course, 99), 5 / 6);
});

test("where not every cell can be seen, coverage is a share of those that can", () => {
  assert.equal(coverageAt({ ...course, cells: 5 }, 99), 1);
  assert.equal(boardAt({ ...course, cells: 5 }, 99).frame.cells, 5);
});

test("the cells of the last move, and the rock that was hit", () => {
  assert.deepEqual(newCells(course, 1), [[0, 2], [1, 0]]);
  assert.deepEqual(newCells(course, 0), [], "what is in sight at the start was shown by no move");
  assert.deepEqual(newCells(course, 99), []);
  assert.deepEqual(crashAt(course, 3), [1, 2]);
  assert.equal(crashAt(course, 2), null);
  assert.equal(crashAt({ ...course, outcome: "explored" }, 3), null);
  assert.deepEqual(crashAt({ ...course, actions: ["east", "south", "south"], outcome: "out_of_bounds" }, 3), [2, 1]);
});
