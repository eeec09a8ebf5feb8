import assert from "node:assert/strict";
import test from "node:test";
import { cellSize, paint } from "../../../../static/task/mars/board.js";
import { runs } from "../../../../static/task/mars/words.js";

test("cells are whole device pixels, and a row paints in runs", () => {
  assert.equal(cellSize(200, 400, 21, 21, 1), 9);
  assert.equal(cellSize(200, 100, 5, 7, 2), 40);
  assert.equal(cellSize(0, 0, 5, 7, 1), 1);
  assert.deepEqual(runs("??.#"), [[0, 2, "?"], [2, 1, "."], [3, 1, "#"]]);
});

/** What is drawn on a canvas: the middle of every arc. */
function drawn(frame) {
  const arcs = [];
  const context = new Proxy({}, { get: (_, name) => (name === "arc" ? (x, y) => arcs.push([x, y]) : () => {}), set: () => true });
  const canvas = { style: {}, setAttribute() {}, getContext: () => context };
  globalThis.getComputedStyle = () => ({ getPropertyValue: () => "#000000" });
  const look = { name: "You", accent: "#fff", width_px: 200, height_px: 200, dpr: 1 };
  paint({ classList: { remove() {} }, querySelector: (part) => (part === "canvas" ? canvas : null) }, { frame, trail: [frame.position] }, look);
  return arcs;
}

test("a crash is marked on the rock that was hit, one over the edge on the board's edge", () => {
  const frame = { rows: 2, cols: 2, grid: ["@#", ".."], position: [0, 0], step: 1, coverage: 1 };
  assert.deepEqual(drawn({ ...frame, heading: "east", outcome: "collided" }), [[150, 50]]);
  const [[x, y]] = drawn({ ...frame, heading: "north", outcome: "out_of_bounds" });
  assert.equal(x, 50);
  assert.ok(y > 40 && y < 50, "the whole mark is on the board");
  assert.deepEqual(drawn({ ...frame, heading: "east", outcome: "explored" }), []);
});
