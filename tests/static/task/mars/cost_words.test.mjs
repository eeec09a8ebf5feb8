import assert from "node:assert/strict";
import { test } from "node:test";
import { costsInWords, placeOf, sentenceOf, summaryOf, triedText } from "../../../../static/task/mars/cost_words.js";

const GRID = ["@.#??", "...??", "?????"];
const mistake = (rest = {}) => ({ first: 22, last: 22, step: 22, cost: 4, action: "west", expert_action: "south", kind: "early detour", previous: "east", position: [0, 0],
  grid: GRID, discovered: 6, missed: [[2, 4], [2, 3]], seen_at: 60, ...rest });
const costs = (rest = {}) => ({ policy: "ppo", reason: null, counts: 85, expert_moves: 64, total: 21, given_up: 0, gained: -3, mistakes: [mistake(), mistake({ cost: 17 })], ...rest });

test("a mistake is one plain sentence: what was done, what was better, and what it would have shown", () => {
  assert.equal(sentenceOf(mistake()), "Move 23 cost 4 moves: you turned back west; "
    + "going south would soon have shown 2 unknown cells to the south-east, which you saw only 38 moves later.");
  assert.equal(sentenceOf(mistake({ cost: 1, action: "north", seen_at: null, missed: [[1, 0]] })), "Move 23 cost 1 move: you turned north; "
    + "going south would soon have shown 1 unknown cell to the south, which you never saw.");
  assert.match(sentenceOf(mistake({ seen_at: null })), /2 unknown cells to the south-east, some of which you never saw\.$/);
  assert.equal(sentenceOf(mistake({ action: "east", missed: [], kind: "last cells" })), "Move 23 cost 4 moves: you went on east; "
    + "going south was the shorter way to the last cells.");
  assert.equal(sentenceOf(mistake({ first: 0, last: 0, step: 0, previous: null, missed: [] })), "Move 1 cost 4 moves: you began by going west; going south was the shorter way.");
  assert.equal(sentenceOf(mistake({ first: 20, last: 23, missed: [] })), "Moves 21 to 24 cost 4 moves: at move 23 you turned back west; going south was the shorter way.");
});

test("an accident says what was hit", () => {
  const accident = { kind: "ended early", cost: 60 };
  assert.match(sentenceOf(mistake({ ...accident, action: "north" })), /: you drove over the edge of the map; going south was free\.$/);
  assert.match(sentenceOf(mistake({ ...accident, action: "west" })), /over the edge of the map/);
  assert.match(sentenceOf(mistake({ ...accident, action: "east", position: [0, 1] })), /: you drove into a rock; /);
});

test("cells lie on one side of the rover, or all around", () => {
  assert.equal(placeOf([[0, 0], [2, 3]], [4, 4]), " to the north-west");
  assert.equal(placeOf([[5, 1], [6, 6]], [4, 4]), " to the south");
  assert.equal(placeOf([[1, 7], [4, 5]], [4, 4]), " to the east");
  assert.equal(placeOf([[4, 2]], [4, 4]), " to the west");
  assert.equal(placeOf([[0, 1], [5, 6]], [4, 4]), "");
});

test("a way that leads round to cells on the other side says so", () => {
  const east = { position: [1, 2], missed: [[1, 4]], seen_at: null };
  assert.match(sentenceOf(mistake({ ...east, action: "north", expert_action: "west" })), /; Expert's way, which begins west, would soon have shown 1 unknown cell to the east, /);
  assert.match(sentenceOf(mistake({ ...east, expert_action: "east" })), /; going east would soon have shown 1 unknown cell to the east, /);
});

test("the lines of an episode add up to what it counts more than Expert's", () => {
  const { summary, mistakes, rest } = costsInWords(costs({ counts: 90, total: 26, gained: -1 }));
  assert.match(summary, /^Your episode counts 90 moves, Expert's 64: 26 more\. Judged with the whole terrain known, /);
  assert.deepEqual(mistakes.map((line) => /cost (\d+) move/.exec(line)?.[1]), ["4", "17"]);
  assert.deepEqual(rest, ["Other mistakes cost 6 moves in all.", "Moves that turned out better than Expert's gained 1 move."]);
  assert.equal(4 + 17 + 6 - 1, 26);
  const none = costsInWords(costs({ counts: 64, total: 0, gained: 0, mistakes: [] }));
  assert.match(none.summary, /^Your episode counts 64 moves, Expert's 64: as many\. No mistake cost 2 moves or more\. /);
  assert.deepEqual(none.rest, []);
  assert.match(summaryOf(costs({ counts: 441, total: 377, given_up: 360 })), /377 more\. Giving up cost 360 moves: Expert would have finished from there\. /);
  assert.match(summaryOf(costs({ counts: 61, total: -3, given_up: 0 })), /: 3 fewer\. /);
});

test("where no move is judged, Expert's episode alone and the reason are said", () => {
  const unjudged = { total: -10, given_up: null, gained: null, mistakes: [], counts: 300, expert_moves: 310, reason: "this board is large" };
  assert.deepEqual(costsInWords(costs(unjudged)), { summary: "Your episode counts 300 moves, Expert's 310: 10 fewer. This board is large.", mistakes: [], rest: [] });
  assert.equal(summaryOf(costs({ ...unjudged, expert_moves: null, total: null, reason: "no file of ppo was kept" })), "No file of ppo was kept.");
});

test("an end of one's own costs no number of moves, and what is tried again is compared with what it came to before", () => {
  assert.match(sentenceOf(mistake({ kind: "ended early", cost: 375, missed: [], action: "north", position: [0, 1] })), /^Move 23 ended the episode: you drove/);
  assert.equal(triedText(80, 76, 9), "80 moves before, 76 now, from move 9.");
  assert.equal(triedText(null, 76, 1), "Not finished before, 76 now, from move 1.");
  assert.equal(triedText(1, null, 9), "1 move before, not finished now, from move 9.");
});
