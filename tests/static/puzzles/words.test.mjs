import assert from "node:assert/strict";
import test from "node:test";
import { cellsLeft, choicesOn, doneText, savesText, shareText, streak, verdictText, whyText } from "../../../static/puzzles/words.js";

const ANSWER = { best: "east", means: { east: 30.2, west: 39.4, north: 37 }, saves: 6.8, error: 1.1, terrains: 96, here: 14,
  shows: { east: [[1, 2], [1, 3]], west: [[5, 5]], north: [[1, 3], [1, 2]] } };
const day = (count) => Array.from({ length: count }, (_, id) => ({ id: String(id), answer: "east", ms: 1000 }));

test("an answer says what was better, by how much on average and here", () => {
  assert.equal(verdictText("east", ANSWER), "East is right.");
  assert.equal(verdictText("west", ANSWER), "East was better than west.");
  assert.match(savesText("east", ANSWER), /^East saves 7 moves on average against the next best; 14 on this terrain\.$/);
  assert.equal(savesText("west", ANSWER), "West costs 9 moves more on average.", "one figure");
  assert.match(savesText("north", { ...ANSWER, here: -1 }), /^East saves 7 moves on average against north; on this terrain it would have cost 1 move\.$/);
  assert.match(savesText("north", { ...ANSWER, here: 0 }), /none on this terrain\.$/);
  assert.equal(doneText(day(3), { 0: ANSWER, 1: { ...ANSWER, best: "west" }, 2: ANSWER }), "That was today: 2 of 3 right.");
});

test("what is shared of a day names no move", () => {
  const answers = { 0: ANSWER, 1: { ...ANSWER, best: "west" }, 2: ANSWER };
  assert.equal(shareText("MarsExplorer", "22 November 2026", day(3), answers, "https://mars.example/puzzles"),
    "MarsExplorer puzzles, 22 November 2026: 2 of 3 right \u2713\u2715\u2713\nhttps://mars.example/puzzles");
});

test("an answer says why: what the better move brings in sight and the other leaves", () => {
  assert.deepEqual(cellsLeft("west", ANSWER), [[1, 2], [1, 3]]);
  assert.equal(whyText("west", ANSWER), "Green: 2 cells that east brings in sight within eight moves here; west leaves them for later.");
});

test("a move that shows no more first saves later", () => {
  const shows = { ...ANSWER.shows, north: [[1, 2], [7, 7], [7, 8]] };
  assert.deepEqual(cellsLeft("north", { ...ANSWER, shows }), []);
  assert.equal(whyText("north", { ...ANSWER, shows }), "Within eight moves here east brings 2 cells in sight and north 3: what east saves comes later on the way.");
  assert.equal(whyText("east", ANSWER), "Within eight moves here east and north each bring 2 cells in sight: what east saves comes later on the way.");
  assert.equal(whyText("east", { ...ANSWER, here: 0 }), "", "nothing is saved here");
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
