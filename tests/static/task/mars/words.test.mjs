import assert from "node:assert/strict";
import test from "node:test";
import { hasTwoBoards, standing } from "../../../../static/play/panels.js";
import { describe, policyName, stepsToGoal, words } from "../../../../static/task/mars/words.js";

const frame = (changes = {}) => ({ episode: "e", step: 16, rows: 3, cols: 4, coverage: 0.2899, score: 0.281, outcome: null, ...changes });

test("a crash says at what coverage and after how many moves, never a number of steps that nobody made", () => {
  assert.equal(words.ending(frame({ outcome: "collided" })).title, "Crashed at 28.9 % after 16 moves");
  assert.equal(words.ending(frame({ outcome: "out_of_bounds", step: 1, coverage: 0 })).title, "Off the map at 0.0 % after 1 move");
  assert.equal(words.ending(frame({ outcome: "explored", coverage: 0.9912 })).title, "Mapped in 16 moves");
});

test("a screen reader hears tenths without a score, the end with it, and new terrains", () => {
  assert.equal(words.announcement(frame({ coverage: 0.41 }), frame({ coverage: 0.44 })), "");
  assert.equal(words.announcement(frame({ coverage: 0.39 }), frame({ coverage: 0.44 })), "40 percent mapped in 16 moves.");
  assert.equal(words.announcement(frame(), frame({ outcome: "collided" })), "Crashed at 28.9 percent after 16 moves. Score 0.281.");
  assert.match(words.announcement(null, frame()), /^New terrain, 3 by 4/);
});

test("below the goal stands what a ranked episode costs, and what follows it", () => {
  const state = { mode: "ranked", counts: true, player: {}, task: { ...words, nameOf: policyName } };
  const text = (...given) => standing(...given).join("");
  assert.match(text(state, "ppo"), /^This ranked episode counts .* abandoned\. After the end, Expert plays the same terrain/);
  assert.match(standing(state, "ppo")[0], /^This ranked episode counts from your first move on, however it ends\.$/, "what a phone shows");
  assert.match(text({ ...state, counts: false }, ""), /does not count: .* a script has moved\.$/);
  assert.match(text({ ...state, mode: "practice" }, "ppo"), /Rocks and the edge/);
});

test("the policy's board is there for whoever has played before, and in a ranked episode only after its end", () => {
  const state = { mode: "practice", player: {}, rival: {} };
  assert.equal(hasTwoBoards(state, false), true);
  assert.equal(hasTwoBoards(state, true), false);
  assert.equal(hasTwoBoards({ ...state, mode: "ranked", rival: null }, false), false);
  assert.equal(hasTwoBoards({ ...state, mode: "ranked" }, false), true);
  assert.equal(hasTwoBoards({ ...state, mode: "watch" }, true), true);
  assert.equal(hasTwoBoards({ ...state, player: null, rival: null }, false), true, "before anything is loaded the page has its final shape");
  assert.equal(hasTwoBoards({ ...state, player: null, rival: null }, true), false);
});

test("where walls hide some of the ground, the goal and the end speak of what can be seen", () => {
  assert.match(words.goal(null), /99 % of the ground/);
  assert.match(words.goal(frame({ cells: 12 })), /99 % of the ground/);
  assert.match(words.goal(frame({ cells: 10 })), /99 % of what can be seen/);
  assert.equal(words.ending(frame({ outcome: "explored", cells: 10 })).line, "99 % of what can be seen is on the map.");
  assert.match(words.ending(frame({ outcome: "timed_out", cells: 12 })).line, /99 % of the ground was/);
});

const board = (changes = {}) => ({ episode: "e", step: 60, rows: 3, cols: 4, grid: ["@.?#", "#.??", "????"], position: [0, 0], coverage: 0.5,
  score: 0.9, outcome: null, ...changes });

test("the comparison says what the other one needed", () => {
  const mine = board({ outcome: "explored" });
  assert.equal(words.compare(mine, board({ outcome: "explored", step: 70 }), "ppo"), "", "the line below the headline says it");
  assert.match(words.compare(mine, board(), "ppo"), /still exploring: 60 moves, 50.0 %/);
  assert.match(words.compare(mine, board({ outcome: "timed_out" }), "ppo"), /did not reach 99 %: out of moves/);
  assert.equal(words.compare(board({ outcome: "collided" }), board({ outcome: "explored", step: 70 }), "Your replay"), "Your replay reached 99 % in 70 moves.");
  assert.match(words.compare(mine, board({ outcome: "timed_out" }), "A script"), /^A script did not reach 99 %/);
  assert.equal(words.compare(mine, null, "ppo"), "");
});

test("only an explored terrain has steps to 99 %", () => {
  assert.equal(stepsToGoal(board({ outcome: "explored" })), 60);
  assert.equal(stepsToGoal(board({ outcome: "timed_out" })), null);
});

test("the matrix in words names the four neighbours, edges too", () => {
  const said = describe(board(), "You");
  assert.match(said, /3 rows, 4 columns/);
  assert.match(said, /north edge, east free, south obstacle, west edge/);
});

test("a packed frame is read as four cells in a character", () => {
  const known = board({ rows: 1, cols: 4, position: [0, 0], heading: "east", grid: ["P"], packed: true });
  assert.match(describe(known, "You"), /north edge, east obstacle, south edge, west edge/);
  assert.match(words.hint(board({ discovered: 0 }), { ...known, discovered: 0 }, new Set()).line, /rock is right in front/);
  const unknown = { ...known, grid: ["#"], step: 20, discovered: 0 };
  assert.doesNotMatch(words.hint(board({ discovered: 0 }), unknown, new Set(["first", "nothing"]))?.line ?? "", /rock|edge|Rocks/i);
});

test("the map in words names runs of cells", () => {
  assert.deepEqual(words.inWords(board(), "You").rows, ["rover, 1 free, 1 unknown, 1 rock", "1 rock, 1 free, 2 unknown", "4 unknown"]);
});

test("the coach speaks from the first move to the last cells", () => {
  const keyOf = (action) => ({ east: "D", south: "S" })[action];
  assert.match(words.coach(board({ step: 0 }), keyOf, "99 %")[1], /with D or S/);
  assert.notDeepEqual(words.coach(board({ step: 20, coverage: 0.4 }), keyOf, "99 %"), words.coach(board({ step: 20, coverage: 0.95 }), keyOf, "99 %"));
  assert.match(words.coach(board({ step: 20, coverage: 0.95 }), keyOf, "96.5 %")[1], /done at 96.5 %/);
});

test("discoveries, crashes and ends are heard; a move that shows nothing new is not", () => {
  const at = (discovered, outcome = null) => ({ discovered, outcome });
  assert.deepEqual(words.sound(at(9), at(13)), { kind: "gain", count: 4 });
  assert.equal(words.sound(at(9), at(9)), null);
  for (const [outcome, kind] of [["collided", "crash"], ["out_of_bounds", "crash"], ["explored", "finish"], ["timed_out", "over"]]) {
    assert.deepEqual(words.sound(at(9), at(12, outcome)), { kind });
  }
});

test("the headline of an end says who did better, a crash and a limit that", () => {
  const end = (outcome, step) => /** @type {any} */ ({ outcome, step, coverage: 0.5, rows: 21, cols: 21, cells: 441 });
  /** @type {[any, any, string | null, string | undefined][]} */
  const cases = [
    [end("explored", 85), end("explored", 64), null, "21 moves behind Expert"],
    [end("explored", 60), end("explored", 61), null, "1 move ahead of Expert"],
    [end("explored", 60), end("explored", 60), null, "Level with Expert"],
    [end("explored", 60), end(null, 60), null, undefined],
    [end("collided", 12), end("explored", 64), null, undefined],
    [end("timed_out", 441), end("explored", 64), null, undefined],
    [end("explored", 76), end("explored", 64), "Nearest", "Expert won by 12 moves"],
    [end("explored", 76), end("collided", 4), "Nearest", "Nearest won: Expert collided"],
    [end("collided", 3), end("timed_out", 441), "Nearest", "Neither mapped 99 %"],
  ];
  for (const [mine, theirs, watched, title] of cases) assert.equal(words.verdict(mine, theirs, "Expert", watched)?.title, title);
  assert.equal(words.verdict(end("explored", 85), end("explored", 64), "Expert", null)?.line, "You needed 85 moves, Expert 64.");
  assert.equal(words.verdict(end("explored", 76), end("explored", 64), "Expert", "Nearest")?.line, "Nearest needed 76 moves, Expert 64.");
  assert.equal(words.verdict(end("explored", 60), end("explored", 60), "Expert", null)?.line, "You needed 60 moves.", "once");
});
