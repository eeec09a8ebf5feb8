import assert from "node:assert/strict";
import test from "node:test";
import { axisEnd, span, tickStep } from "../../../static/common/chart_scale.js";

test("the step axis grows in round numbers and keeps few labels", () => {
  assert.equal(axisEnd(0), 40);
  assert.equal(axisEnd(60), 80);
  assert.equal(axisEnd(441), 500);
  for (const steps of [0, 60, 441, 7056, 16384]) assert.ok(axisEnd(steps) > steps && axisEnd(steps) / tickStep(axisEnd(steps)) <= 8);
});

test("values span from the lowest to the highest that came", () => {
  assert.equal(span([]), null);
  assert.equal(span([null, undefined]), null);
  assert.deepEqual(span([3, null, -1]), [-1, 3]);
  assert.deepEqual(span([2]), [1.5, 2.5]);
  assert.equal(axisEnd(10), 40);
});
