import assert from "node:assert/strict";
import { test } from "node:test";
import { cameraOf, hasEffects, LARGE_SIDE } from "../../../../static/task/mars/views.js";

test("large boards are followed until somebody chooses", () => {
  assert.equal(cameraOf(null, LARGE_SIDE), "map");
  assert.equal(cameraOf(null, LARGE_SIDE + 1), "follow");
  assert.equal(cameraOf("map", 84), "map");
  assert.equal(cameraOf("follow", 5), "follow");
});

test("effects are off where the processor draws or the system asks for calm, unless they are chosen", () => {
  assert.equal(hasEffects(null, false, false), true);
  assert.equal(hasEffects("auto", true, false), false);
  assert.equal(hasEffects(null, false, true), false);
  assert.equal(hasEffects("on", true, true), true);
  assert.equal(hasEffects("off", false, false), false);
});
