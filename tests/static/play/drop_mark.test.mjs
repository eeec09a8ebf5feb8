import assert from "node:assert/strict";
import test from "node:test";
import { addedUp, droppedText } from "../../../static/play/input.js";

test("what became of presses is one sentence", () => {
  assert.equal(droppedText("rock", 5), "Stopped before a rock: 5 presses dropped.");
  assert.equal(droppedText("edge", 1), "Stopped before the edge: 1 press dropped.");
  assert.equal(droppedText("rock", 0), "Stopped before a rock.");
});

test("presses that were dropped for one reason, or of one burst, are added up", () => {
  assert.deepEqual(addedUp(null, "rock", 1), { reason: "rock", count: 1 });
  assert.deepEqual(addedUp({ reason: "rock", count: 4 }, "rock", 1), { reason: "rock", count: 5 });
  assert.deepEqual(addedUp({ reason: "edge", count: 4 }, "rock", 1), { reason: "rock", count: 5 });
  assert.deepEqual(addedUp({ reason: "rock", count: 4 }, "ended", 2), { reason: "ended", count: 2 });
});
