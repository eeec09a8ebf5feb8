// A finished episode: its course move by move.
import assert from "node:assert/strict";
import test from "node:test";
import { boardAt, courseOf, newCells, progressAt } from "../../../../static/task/mars/course.js";

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
  assert.equal(progressAt(course, 99), 5 / 6);
});

test("where not every cell can be seen, coverage is a share of those that can", () => {
  assert.equal(progressAt({ ...course, cells: 5 }, 99), 1);
  assert.equal(boardAt({ ...course, cells: 5 }, 99).frame.cells, 5);
});

test("the cells of the last move", () => {
  assert.deepEqual(newCells(course, 1), [[0, 2], [1, 0]]);
  assert.deepEqual(newCells(course, 0), [], "what is in sight at the start was shown by no move");
  assert.deepEqual(newCells(course, 99), []);
});

const frame = (changes = {}) => ({ kind: "frame", episode: "e1", step: 0, rows: 2, cols: 3, grid: ["@.?", "#??"], position: [0, 0],
  discovered: 3, cells: 6, coverage: 0.5, heading: "east", reward: null, return: null, score: null, outcome: null, ...changes });

test("frames tell the course of an episode, also where some are left out", () => {
  const frames = [frame(), frame({ step: 3, grid: [".@.", "#??"], position: [0, 1], discovered: 4, heading: "south", outcome: "abandoned" })];
  const course = courseOf("You", frames);
  assert.deepEqual([course.actions.length, course.cells, course.outcome], [3, 6, "abandoned"]);
  assert.deepEqual([0, 2, 3].map((step) => boardAt(course, step).frame.grid[0]), ["..?", "..?", "..."]);
  assert.deepEqual(course.positions, [[0, 0], [0, 0], [0, 0], [0, 1]]);
  assert.deepEqual(course.discovered, [3, 3, 3, 4]);
  assert.deepEqual([1, 3].map((step) => boardAt(course, step).frame.outcome), [null, "abandoned"]);
  assert.equal(courseOf("You", []), null);
});
