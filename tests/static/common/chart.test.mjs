import assert from "node:assert/strict";
import test from "node:test";
import { stepsEnd } from "../../../static/common/chart.js";
import { axisOfShares, movesAxis, roundUp } from "../../../static/common/chart_scale.js";

test("an axis of moves ends at a round number and has few numbers on it", () => {
  const boards = [{ progress: [0.2, 0.5], frame: { outcome: "collided" } }, { progress: Array(61).fill(1), frame: {} }];
  const end = stepsEnd(boards);
  assert.equal(end, 80);
  const { low, high, ticks, text } = movesAxis(end);
  assert.deepEqual([low, high, ticks, text(0), text(10)], [0, 80, [0, 10, 20, 30, 40, 50, 60, 70, 80], "0 moves", "10"]);
  assert.deepEqual([stepsEnd(boards.map((each) => ({ ...each, frame: { outcome: "explored" } }))), stepsEnd(boards.slice(0, 1))], [60, 10]);
  assert.deepEqual([stepsEnd([]), movesAxis(0).high], [40, 1]);
  assert.deepEqual([roundUp(141, 141), roundUp(441, 441), roundUp(1001, 1001)], [160, 500, 1500]);
});

test("an axis of shares has fewer numbers where the chart is low", () => {
  assert.deepEqual([60, 200].map((height) => axisOfShares(height).ticks), [[0, 0.5], [0, 0.25, 0.5, 0.75]]);
  assert.equal(axisOfShares(200).text(0.25), "25 %");
});
