import assert from "node:assert/strict";
import { test } from "node:test";
import { placeOf, sentenceOf, summaryOf, triedText } from "../../../../static/task/mars/losses.js";

const GRID = ["@.#??", "...??", "?????"];
const loss = (rest = {}) => ({ step: 22, regret: 4, action: "west", best_action: "south", kind: "early detour", previous: "east", position: [0, 0],
  grid: GRID, discovered: 6, missed: [[2, 4], [2, 3]], seen_at: 60, ...rest });

test("a costly move is one plain sentence: what was done, what was better, and what it would have shown", () => {
  assert.equal(sentenceOf(loss()), "Move 23 cost about 4 moves: you turned back west; "
    + "going south would soon have shown 2 unknown cells in the south-east corner, which you saw only 38 moves later.");
  assert.equal(sentenceOf(loss({ regret: 1, action: "north", seen_at: null, missed: [[1, 3]] })), "Move 23 cost about 1 move: you turned north; "
    + "going south would soon have shown 1 unknown cell, which you never saw.");
  assert.equal(sentenceOf(loss({ action: "east", missed: [], kind: "last cells" })), "Move 23 cost about 4 moves: you went on east; "
    + "going south was the shorter way to the last cells.");
  assert.equal(sentenceOf(loss({ step: 0, previous: null, missed: [] })), "Move 1 cost about 4 moves: you began by going west; going south was the shorter way.");
});

test("an accident says what was hit", () => {
  const accident = { kind: "ended early", regret: 60 };
  assert.match(sentenceOf(loss({ ...accident, action: "north" })), /: you drove over the edge of the map; going south was free\.$/);
  assert.match(sentenceOf(loss({ ...accident, action: "west" })), /over the edge of the map/);
  assert.match(sentenceOf(loss({ ...accident, action: "east", position: [0, 1] })), /: you drove into a rock; /);
});

test("cells lie in a corner, at an edge, or anywhere", () => {
  const grid = Array.from({ length: 6 }, () => "????????");
  assert.equal(placeOf([[0, 0], [2, 3]], grid), " in the north-west corner");
  assert.equal(placeOf([[5, 1], [4, 6]], grid), " at the south edge");
  assert.equal(placeOf([[1, 7], [4, 5]], grid), " at the east edge");
  assert.equal(placeOf([[0, 0], [3, 1]], grid), " at the west edge", "they reach too far south for a corner");
  assert.equal(placeOf([[0, 1], [5, 6]], grid), "", "from one edge to the other is nowhere in particular");
  assert.equal(placeOf([[2, 3]], grid), "");
});

test("the summary says by what moves are judged", () => {
  const analysis = (rest = {}) => ({ policy: "ppo", total: 9, given_up: 0, losses: [loss(), loss()], ...rest });
  assert.match(summaryOf(analysis()), /^These 2 moves cost you the most\. Judged by how Expert would have finished/);
  assert.match(summaryOf(analysis({ losses: [] })), /^No single move cost you much/);
  assert.match(summaryOf(analysis({ given_up: 7 })), /^Giving up cost 7 moves/);
});

test("an end of one's own costs no number of moves, and what is tried again is compared with what it came to before", () => {
  assert.match(sentenceOf(loss({ kind: "ended early", regret: 375, missed: [], action: "north", position: [0, 1] })), /^Move 23 ended the episode: you drove/);
  assert.equal(triedText(80, 76, 9), "80 moves before, 76 now, from move 9.");
  assert.equal(triedText(null, 76, 1), "Not finished before, 76 now, from move 1.");
  assert.equal(triedText(1, null, 9), "1 move before, not finished now, from move 9.");
});
