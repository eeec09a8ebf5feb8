import assert from "node:assert/strict";
import test from "node:test";
import { ahead, cellAfter, linesOf } from "../../../../static/task/mars/ground.js";

const groundAhead = (...move) => ahead(...move).stop ?? ahead(...move);

test("a packed frame has four cells in a character, and the rover where it stands", () => {
  const packed = { cols: 6, position: [0, 4], grid: ["AG", "t#"], packed: true };
  assert.deepEqual(linesOf(packed), [".?.?@.", "####??"]);
  assert.equal(groundAhead(packed, [], "south"), "unknown");
  assert.equal(groundAhead(packed, ["west", "west"], "south"), "Stopped before a rock");
  assert.equal(groundAhead(packed, [], "north"), "Stopped before the edge");
  assert.equal(linesOf(frame), frame.grid);
});

const frame = { position: [1, 1], grid: ["?#..", ".@..", "...."] };

test("a move leads to ground that is known, to a rock, off the grid, or where nobody has looked", () => {
  assert.equal(groundAhead(frame, [], "east"), "free");
  assert.equal(groundAhead(frame, [], "north"), "Stopped before a rock");
  assert.equal(groundAhead(frame, ["west"], "north"), "unknown");
  assert.equal(groundAhead(frame, ["south"], "south"), "Stopped before the edge");
  assert.equal(groundAhead(frame, ["west"], "west"), "Stopped before the edge");
});

test("moves that wait are made first", () => {
  assert.deepEqual(["east", "south", "south", "west"].reduce(cellAfter, frame.position), [3, 1]);
  assert.equal(groundAhead(frame, ["east", "east"], "north"), "free");
  assert.equal(groundAhead(frame, ["east", "east"], "east"), "Stopped before the edge");
});
