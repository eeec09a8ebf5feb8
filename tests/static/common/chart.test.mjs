import assert from "node:assert/strict";
import test from "node:test";
import { drawBand, drawLine } from "../../../static/common/chart.js";
import { linearScale, roundUp } from "../../../static/common/chart_scale.js";
import { curveOf } from "../../../static/common/coverage_chart.js";

/** A canvas context that only notes where lines begin and go. */
function fakeContext() {
  const drawn = [];
  const ignored = ["beginPath", "closePath", "stroke", "fill", "setLineDash"];
  return { drawn, moveTo: (x, y) => drawn.push(["move", x, y]), lineTo: (x, y) => drawn.push(["line", x, y]),
    ...Object.fromEntries(ignored.map((name) => [name, () => {}])) };
}

test("a line breaks where a point is missing", () => {
  const context = fakeContext();
  drawLine(context, [{ x: 0, y: 1 }, { x: 1, y: 2 }, null, { x: 3, y: 4 }], { colour: "red" });
  assert.deepEqual(context.drawn, [["move", 0, 1], ["line", 1, 2], ["move", 3, 4]]);
});

test("a band goes along the lower line and back along the upper one", () => {
  const context = fakeContext();
  drawBand(context, [{ x: 0, y: 9 }, { x: 5, y: 8 }], [{ x: 0, y: 1 }, { x: 5, y: 2 }], "red");
  assert.deepEqual(context.drawn, [["line", 0, 9], ["line", 5, 8], ["line", 5, 2], ["line", 0, 1]]);
});

test("a scale puts the low end left and at the bottom", () => {
  const at = linearScale({ left: 10, right: 110, top: 20, bottom: 70 }, { low: 0, high: 4 }, { low: -1, high: 1 });
  assert.deepEqual([at.x(0), at.x(4), at.y(-1), at.y(1), at.y(0)], [10, 110, 70, 20, 45]);
  assert.deepEqual([roundUp(141, 141), roundUp(441, 441), roundUp(1001, 1001)], [160, 500, 1500]);
});

test("a curve is a share of the cells that count on its terrain", () => {
  const board = { name: "ppo", frame: { rows: 3, cols: 4, cells: 10 }, discovered: [2, 5] };
  assert.deepEqual(curveOf(board, { colour: "teal", isDashed: true }), { name: "ppo", colour: "teal", isDashed: true, discovered: [2, 5], cells: 10 });
});
