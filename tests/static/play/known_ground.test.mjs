import assert from "node:assert/strict";
import test from "node:test";
import { cellAfter, groundAhead } from "../../../static/play/press_queue.js";

const frame = { position: [1, 1], grid: ["?#..", ".@..", "...."] };

test("a move leads to ground that is known, to a rock, off the grid, or where nobody has looked", () => {
  assert.equal(groundAhead(frame, [], "east"), "free");
  assert.equal(groundAhead(frame, [], "north"), "rock");
  assert.equal(groundAhead(frame, ["west"], "north"), "unknown");
  assert.equal(groundAhead(frame, ["south"], "south"), "edge");
  assert.equal(groundAhead(frame, ["west"], "west"), "edge");
});

test("moves that wait are made first", () => {
  assert.deepEqual(cellAfter(frame, ["east", "south", "south", "west"]), [3, 1]);
  assert.equal(groundAhead(frame, ["east", "east"], "north"), "free");
  assert.equal(groundAhead(frame, ["east", "east"], "east"), "edge");
});
