import assert from "node:assert/strict";
import test from "node:test";
import { inFront as ahead, words } from "../../../../static/task/mars/words.js";

const hintAfter = words.hint;

const frame = (changes = {}) => ({ episode: "e1", step: 1, rows: 4, cols: 5, grid: ["@....", ".....", "?????", "?????"], position: [0, 0],
  discovered: 10, coverage: 0.1, heading: "east", outcome: null, ...changes });
const before = frame({ step: 0, discovered: 4 });
const nobody = new Set();
const first = new Set(["first"]);

test("what lies in front of the rover is the cell in its heading, or the edge", () => {
  assert.equal(ahead(frame()), ".");
  assert.equal(ahead(frame({ heading: "north" })), "edge");
  assert.equal(ahead(frame({ heading: "west" })), "edge");
  assert.equal(ahead(frame({ position: [1, 2], heading: "south" })), "?");
  assert.equal(ahead(frame({ position: [3, 4], heading: "south" })), "edge");
});

test("the first moves name what they uncovered, and each piece of advice comes once", () => {
  assert.deepEqual(hintAfter(before, frame(), nobody), { id: "first", gain: "+6 new cells", line: "Your lidar uncovers what is in sight." });
  assert.equal(hintAfter(before, frame({ discovered: 5 }), nobody).gain, "+1 new cell");
  const later = frame({ step: 3, discovered: 12 });
  assert.deepEqual(hintAfter(frame({ step: 2 }), later, first), { id: "", gain: "+2 new cells", line: "" });
  assert.equal(hintAfter(frame({ step: 9 }), frame({ step: 10, discovered: 12 }), first), null, "later moves are not counted out");
});

test("danger comes before all other advice", () => {
  const rock = frame({ step: 2, grid: ["@#...", ".....", "?????", "?????"] });
  assert.match(hintAfter(before, rock, nobody).line, /rock is right in front of you. Hitting it ends the episode/);
  assert.match(hintAfter(before, rock, new Set(["rock", "first"])).line, /There are rocks on the map/);
  const said = hintAfter(before, { ...rock, step: 1 }, nobody);
  assert.equal(said.id, "rock", "also where the very first move ends before a rock");
  assert.match(hintAfter(frame(), rock, new Set([said.id])).line, /Your lidar uncovers/, "which leaves nobody without the first sentence");
  assert.match(hintAfter(before, frame({ step: 2, heading: "north" }), nobody).line, /edge of the map is right in front of you/);
});

test("a move that uncovers nothing is answered, milestones are named", () => {
  assert.match(hintAfter(frame({ step: 4 }), frame({ step: 5 }), first).line, /Nothing new there/);
  for (const [coverage, said] of [[0.3, /quarter/], [0.6, /Half/], [0.95, /Nearly/]]) {
    assert.match(hintAfter(frame({ step: 30 }), frame({ step: 31, coverage, discovered: 11 }), first).line, said);
  }
});
