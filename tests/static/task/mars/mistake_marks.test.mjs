import assert from "node:assert/strict";
import { test } from "node:test";
import { chartMarkAt, numberAt, markRadius, paintMistakeMarks, placeMarks, placeOnCurve } from "../../../../static/task/mars/mistake_marks.js";
import { boardBefore } from "../../../../static/task/mars/costs.js";

const at = (row, col) => ({ position: [row, col] });

test("numbers stand at their cells, and aside where another stands there already", () => {
  const [first, second, third] = placeMarks([at(2, 3), at(2, 3), at(9, 9)], 20, 10);
  assert.deepEqual(first, { x: 70, y: 50 });
  assert.ok(Math.hypot(second.x - first.x, second.y - first.y) >= 19);
  assert.deepEqual(third, { x: 190, y: 190 });
});

test("a number is found by a point near it, and by no other", () => {
  const mistakes = [at(2, 3), at(9, 9)];
  assert.equal(numberAt(mistakes, { x: 75, y: 44 }, 20, 1), 0);
  assert.equal(numberAt(mistakes, { x: 190, y: 190 }, 20, 1), 1);
  assert.equal(numberAt(mistakes, { x: 130, y: 130 }, 20, 1), null);
  assert.ok(markRadius(4, 2) >= 17, "and it stays large enough for a finger on small cells");
});

test("on the chart a number stands on the curve, or above the one before", () => {
  const scale = { x: (step) => 10 * step, y: (share) => 100 - 90 * share };
  const places = placeOnCurve([{ step: 5, discovered: 5 }, { step: 5, discovered: 5 }], 10, scale);
  assert.deepEqual(places[0], { x: 50, y: 55 });
  assert.equal(places[1].x, 50);
  assert.ok(places[1].y <= 39);
  assert.equal(chartMarkAt(places, { x: 52, y: 54 }), 0);
  assert.equal(chartMarkAt(places, { x: 52, y: 90 }), null);
});

test("a chosen move shows the board as it was known before it", () => {
  const frame = { kind: "frame", episode: "e", step: 3, rows: 2, cols: 2, grid: ["..", "@#"], position: [1, 0], discovered: 4, cells: 4, coverage: 1,
    heading: "south", reward: 1, return: 1, score: 1, outcome: "explored" };
  const board = { session: "s", name: "You", frame, trail: [[0, 0], [0, 1], [0, 0], [1, 0]], progress: [0.25, 0.5, 0.5, 1] };
  const before = boardBefore(board, { step: 1, grid: [".@", "??"], position: [0, 1], discovered: 2, previous: "east" });
  assert.deepEqual(before.trail, [[0, 0], [0, 1]]);
  assert.deepEqual([before.frame.grid, before.frame.position, before.frame.coverage, before.frame.heading, before.frame.outcome],
    [[".@", "??"], [0, 1], 0.5, "east", null]);
  assert.equal(board.frame.step, 3, "the board itself stays as it is");
});

test("a puzzle's answer is arrows alone, without a number", () => {
  const texts = [];
  const context = new Proxy({ fillText: (text) => texts.push(text) }, { get: (own, name) => own[name] ?? (() => {}), set: () => true });
  const mistakes = [{ ...at(2, 3), action: "north", expert_action: "east", missed: [] }];
  const look = { made: "red", better: "green", casing: "black", dpr: 1 };
  for (const hasNumbers of [true, false]) paintMistakeMarks(context, { mistakes, chosen: 0, hasNumbers }, 20, look);
  assert.deepEqual(texts.map(String), ["1"]);
});
