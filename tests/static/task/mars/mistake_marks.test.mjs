import assert from "node:assert/strict";
import { test } from "node:test";
import { chartMarkAt, numberAt, markRadius, paintMistakeMarks, placeMarks, placeOnCurve } from "../../../../static/task/mars/mistake_marks.js";
import { boardBefore } from "../../../../static/task/mars/costs.js";

const at = (row, col) => ({ position: [row, col] });

const SHAPE = { rows: 12, cols: 12 };

test("numbers stand beside their cells within the board, and hide neither the rover nor one another", () => {
  for (const cells of [[[2, 3], [2, 3], [9, 9]], [[0, 0], [0, 0]], [[11, 11], [11, 11], [11, 10]]]) {
    const places = placeMarks(cells.map(([row, col]) => at(row, col)), SHAPE, 20, 10);
    for (const [index, { x, y }] of places.entries()) {
      assert.ok(Math.min(x, y) >= 10 && Math.max(x, y) <= 230, "within the board");
      for (const [row, col] of cells) assert.ok(Math.max(Math.abs(x - 20 * col - 10), Math.abs(y - 20 * row - 10)) >= 17, "off the cells");
      for (const other of places.slice(index + 1)) assert.ok(Math.hypot(other.x - x, other.y - y) >= 20, "off one another");
    }
  }
});

test("the head of an arrow stays on the board, also of a move over its edge", () => {
  for (const [position, action, expert_action] of [[[0, 3], "north", "west"], [[1, 3], "north", "south"], [[11, 11], "south", "east"]]) {
    const points = [];
    const add = (x, y) => points.push(x, y);
    const context = new Proxy({ moveTo: add, lineTo: add }, { get: (own, name) => own[name] ?? (() => {}), set: () => true });
    paintMistakeMarks(context, { mistakes: [{ position, action, expert_action, missed: [] }], chosen: 0 }, 20,
      { ...SHAPE, made: "red", better: "green", casing: "black", dpr: 1 });
    assert.ok(points.length && Math.min(...points) >= 0 && Math.max(...points) <= 240, `${position} ${action}: ${points}`);
  }
});

test("until one is chosen no arrow hides another: each number is led to its cell", () => {
  const drawn = [];
  const context = new Proxy({ moveTo: (...point) => drawn.push(["from", ...point]), closePath: () => drawn.push(["head"]) }, { get: (own, name) => own[name] ?? (() => {}), set: () => true });
  const mistakes = [[1, 0], [1, 0], [2, 0]].map(([row, col]) => ({ ...at(row, col), action: "north", expert_action: "south", missed: [] }));
  const look = { ...SHAPE, made: "red", better: "green", casing: "black", dpr: 1 };
  paintMistakeMarks(context, { mistakes, chosen: null }, 20, look);
  assert.deepEqual(drawn.filter(([kind]) => kind === "head"), []);
  assert.deepEqual(new Set(drawn.map(([, x, y]) => `${x} ${y}`)), new Set(["10 50", "10 30"]));
  drawn.length = 0;
  paintMistakeMarks(context, { mistakes, chosen: 1 }, 20, look);
  assert.ok(drawn.some(([kind]) => kind === "head"), "the chosen one has its two arrows");
});

test("a number is found by a point near it, and by no other", () => {
  const mistakes = [at(2, 3), at(9, 9)];
  const [first, second] = placeMarks(mistakes, SHAPE, 20, markRadius(20, 1));
  assert.equal(numberAt(mistakes, SHAPE, { x: first.x + 5, y: first.y - 6 }, 20, 1), 0);
  assert.equal(numberAt(mistakes, SHAPE, second, 20, 1), 1);
  assert.equal(numberAt(mistakes, SHAPE, { x: 130, y: 110 }, 20, 1), null);
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
  const look = { ...SHAPE, made: "red", better: "green", casing: "black", dpr: 1 };
  for (const hasNumbers of [true, false]) paintMistakeMarks(context, { mistakes, chosen: 0, hasNumbers }, 20, look);
  assert.deepEqual(texts.map(String), ["1"]);
});
