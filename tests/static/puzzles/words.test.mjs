import assert from "node:assert/strict";
import test from "node:test";
import { choicesOn, doneText, savesText, streak, verdictText } from "../../../static/puzzles/words.js";

const ANSWER = { best: "east", means: { east: 30.2, west: 39.4, north: 37 }, saves: 6.8, error: 1.1, terrains: 96, here: 14 };
const day = (count) => Array.from({ length: count }, (_, id) => ({ id: String(id), answer: "east", ms: 1000 }));

test("an answer says what was better, by how much on average and here", () => {
  assert.equal(verdictText("east", ANSWER), "East is right.");
  assert.equal(verdictText("west", ANSWER), "East was better than west.");
  assert.match(savesText("east", ANSWER), /^East saves 7 moves on average against the next best; 14 on this terrain\.$/);
  assert.match(savesText("west", { ...ANSWER, here: -1 }), /^West costs 9 moves more on average\. East saves .* on this terrain it would have cost 1 move\.$/);
  assert.match(savesText("west", { ...ANSWER, here: 0 }), /none on this terrain\.$/);
  assert.equal(doneText(day(3), { 0: ANSWER, 1: { ...ANSWER, best: "west" }, 2: ANSWER }), "That was today: 2 of 3 right.");
});

test("a streak counts days with all three answered, up to today or to yesterday", () => {
  const stored = { "2026-02-27": day(3), "2026-02-28": day(3), "2026-03-01": day(3), "2026-03-02": day(2) };
  assert.equal(streak(stored, "2026-03-01", 3), 3);
  assert.equal(streak(stored, "2026-03-02", 3), 3);
  assert.equal(streak(stored, "2026-03-03", 3), 0);
});

test("what no page of ours has stored is not believed", () => {
  for (const stored of [null, 7, [], { "2026-03-01": "x" }, { "2026-03-01": [1, null, { id: 3 }] }]) {
    assert.deepEqual(choicesOn(stored, "2026-03-01"), []);
    assert.equal(streak(stored, "2026-03-01", 3), 0);
  }
});
