import assert from "node:assert/strict";
import { test } from "node:test";
import { cameraOf, freeCorner, hasEffects } from "../../../../static/task/mars/views.js";
import { LARGE_SIDE } from "../../../../static/task/mars/zoom.js";

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

test("the small map lies where neither rover nor route is, and nowhere once the route has been in every corner", () => {
  const at = (...position) => ({ rows: 21, cols: 21, position });
  const edge = Array.from({ length: 14 }, (_, col) => [0, col]);
  assert.equal(freeCorner(at(0, 0), [[0, 0]]), "north-east");
  assert.equal(freeCorner(at(0, 13), edge), "south-east", "along the north edge to the east");
  assert.equal(freeCorner(at(20, 20), [...edge, [20, 20]]), "south-west");
  assert.equal(freeCorner(at(10, 10), [[0, 20], [20, 20], [20, 0]]), "north-west");
  assert.equal(freeCorner(at(10, 10), [[0, 20], [20, 20], [20, 0], [0, 0]]), "none");
});
