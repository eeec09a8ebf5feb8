import assert from "node:assert/strict";
import test from "node:test";
import { addedUp, droppedText } from "../../../static/play/input.js";

const ROCK = { stop: "Stopped before a rock" };
const EDGE = { stop: "Stopped before the edge" };

test("what became of presses is one sentence", () => {
  assert.equal(droppedText(ROCK, 5), "Stopped before a rock: 5 presses dropped.");
  assert.equal(droppedText(EDGE, 1), "Stopped before the edge: 1 press dropped.");
  assert.equal(droppedText(ROCK, 0), "Stopped before a rock.");
});

test("presses that were dropped for one reason, or of one burst, are added up", () => {
  assert.deepEqual(addedUp(null, ROCK, 1), { reason: ROCK, count: 1 });
  assert.deepEqual(addedUp({ reason: ROCK, count: 4 }, ROCK, 1), { reason: ROCK, count: 5 });
  assert.deepEqual(addedUp({ reason: EDGE, count: 4 }, ROCK, 1), { reason: ROCK, count: 5 });
  assert.deepEqual(addedUp({ reason: ROCK, count: 4 }, "ended", 2), { reason: "ended", count: 2 });
});
