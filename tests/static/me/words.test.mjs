import assert from "node:assert/strict";
import test from "node:test";
import { taskOf } from "../../../static/task/mars/index.js";
import { MARS } from "../task/mars/about.mjs";
import { bestText, dailyText, gapsText, idleIn, idleText, isFinished, kindText, personalText, puzzlesText, rankedText, standingText, summary } from "../../../static/me/words.js";

const task = taskOf(MARS);
const best = { place: "Scattered 21 \u00d7 42", max_steps: 882, episodes: 4, successes: 3, best: null, people: { means: [80, 90.5, 120], you: 90.5, ranked: 5, missing: 0 } };

test("a player's place is among the people, by their mean", () => {
  assert.equal(standingText(task, best), "You need 90.5 moves on average, over 5 ranked episodes: place 2 of 3 people. A terrain that was not finished counts the limit.");
  assert.match(standingText(task, { ...best, people: { means: [80], you: 80, ranked: 6, missing: 0 } }), /only person with so many so far/);
});

test("below five ranked episodes there is no mean and no place, and the page says how many are missing", () => {
  const of = (ranked, means) => standingText(task, { ...best, people: { means, you: null, ranked, missing: 5 - ranked } });
  const needs = "A mean and a place need 5 ranked episodes.";
  assert.equal(of(0, []), `${needs} You have none here that counts yet: 5 are missing. Nobody has so many yet.`);
  assert.equal(of(1, [80]), `${needs} You have 1 ranked episode that counts: 4 are missing. 1 person has so many.`);
  assert.equal(of(4, [80, 90]), `${needs} You have 4 ranked episodes that count: 1 is missing. 2 people have so many.`);
});

test("a ranked episode that does not count is called that, and says why", () => {
  const of = (episode) => kindText(task, { kind: "ranked", counts: false, day: null, not_attested: null, met_before: false, ...episode });
  assert.deepEqual(of({ counts: true }), ["ranked", ""]);
  assert.deepEqual(of({ kind: "practice" }), ["practice", ""]);
  assert.deepEqual(of({ kind: "daily", day: "2026-01-02" }), ["daily", "The daily terrain of 2026-01-02"]);
  assert.deepEqual(of({ met_before: true }), ["ranked, does not count", "Does not count: you had met its terrain before"]);
  assert.deepEqual(of({ not_attested: "too fast" }), ["ranked, does not count", "Does not count: too fast"]);
});

test("a spoilt episode is not finished, and one that merely does not count is", () => {
  const of = (episode) => isFinished(task, { outcome: "explored", counts: true, not_attested: null, ...episode });
  assert.deepEqual([of({}), of({ outcome: "collided" })], [true, false]);
  assert.deepEqual([of({ not_attested: "no key" }), of({ counts: false, not_attested: "a bot" })], [false, true]);
});

test("the page says in a sentence what was driven", () => {
  assert.match(summary(task, { total: 0, episodes: [], bests: [] }), /once one has ended/);
  assert.equal(summary(task, { total: 5, episodes: [], bests: [best] }), "You have played 5 episodes in this browser, and came to 99 % in 3 terrains.");
  assert.equal(bestText(task, { ...best, best: {} }), "3 of 4 episodes came to 99 %.");
  assert.match(bestText(task, { ...best, successes: 0 }), /None came to 99 %/);
  assert.equal(task.outcome("collided"), "crashed");
});

test("an episode is measured by one's own best and by the last ten on terrains like it", () => {
  const played = (number, moves, rest = {}) => ({ episode: `e${number}`, place: "Scattered 21 \u00d7 21", outcome: "explored", moves, ended_ms: number, ...rest });
  const older = Array.from({ length: 12 }, (_, at) => played(12 - at, 100)), other = played(13, 1, { place: "Scattered 42 \u00d7 42" });
  const history = (newest, best) => ({ total: 14, episodes: [newest, other, ...older], bests: [{ place: "Scattered 21 \u00d7 21", best }] });
  assert.equal(personalText(task, history(played(14, 80), played(14, 80)), "e14"), "Your best so far.");
  assert.equal(personalText(task, history(played(14, 90), played(3, 70)), "e14"), "Better than your last ten, which took 100.0 moves on average. Your best on a terrain that was new to you is 70 moves.");
  assert.equal(personalText(task, history(played(14, 110), played(3, 70)), "e14"), "Your best on a terrain that was new to you is 70 moves.");
  assert.equal(personalText(task, history(played(14, 60), played(3, 82)), "e14"), "Better than your last ten, which took 100.0 moves on average. Your best on a terrain that was new to you is 82 moves. This one is no best: its terrain was chosen or met before, or a script has moved.");
  assert.equal(personalText(task, history(played(14, 90, { outcome: "collided" }), played(3, 70)), "e14"), "");
  assert.equal(personalText(task, { total: 1, episodes: [played(1, 80)], bests: [{ place: "Scattered 21 \u00d7 21", best: played(1, 80) }] }, "e1"), "", "a first one has nothing before it");
});

test("the curve of gaps to Expert is said in words, and an unfinished episode enters no mean", () => {
  const of = (...gaps) => gapsText(task, gaps.map((gap) => ({ gap: gap ?? 400, isFinished: gap !== null })));
  assert.match(of(), /^No ranked terrain yet/);
  assert.equal(of(40, 20, 10), "You needed 23.3 moves more than Expert on average, over 3 finished episodes. +40.0 in the first, +10.0 in the last.");
  assert.equal(of(7, null), "You needed 7.0 moves more than Expert in 1 finished episode. 1 episode was not finished (a cross).");
  assert.equal(of(-7, null, null), "You needed 7.0 moves fewer than Expert in 1 finished episode. 2 episodes were not finished (crosses).");
  assert.match(of(40, 20, 10, 20), /\+30.0 over the first 2, \+15.0 over the last 2\.$/);
  assert.equal(of(1, -1), "You needed as many moves as Expert on average, over 2 finished episodes. +1.0 in the first, \u22121.0 in the last.");
  assert.equal(of(null), "1 episode was not finished (a cross).");
});

test("the daily terrain and the puzzles say how today stands, and the days in a row", () => {
  const attempt = { state: "ended", outcome: "explored", moves: 71 };
  assert.equal(dailyText(task, { attempt: null, streak: 0 }), "not played today");
  assert.equal(dailyText(task, { attempt, streak: 3 }), "71 moves today, 3 days in a row");
  assert.equal(dailyText(task, { attempt: { ...attempt, outcome: "collided" }, streak: 1 }), "played today");
  assert.equal(dailyText(task, { attempt: { ...attempt, state: "open" }, streak: 2 }), "begun today, 2 days in a row");
  const today = { day: "2026-03-02", puzzles: [1, 2, 3] };
  const chosen = [1, 2, 3].map((id) => ({ id: String(id), answer: "east", ms: 9 }));
  assert.equal(puzzlesText(today, null), "not answered today");
  assert.equal(puzzlesText(today, { "2026-03-01": chosen, "2026-03-02": chosen.slice(1) }), "2 of 3 answered today");
  assert.equal(puzzlesText(today, { "2026-03-01": chosen, "2026-03-02": chosen }), "3 of 3 answered today, 2 days in a row");
});

test("the longest way that showed nothing new is where one would drive on otherwise", () => {
  assert.deepEqual(idleIn([0.1, 0.2, 0.2, 0.3, 0.3, 0.3, 0.4, 0.4, 0.4, 0.4]), { after: 3, moves: 2 });
  assert.deepEqual(idleIn([0.1, 0.2]), { after: 0, moves: 0 });
  assert.equal(idleText({ after: 1, moves: 12 }), "after 1 move: then 12 showed nothing new");
});

test("a ranked end says what it is worth among people, and only on the terrains of their board", () => {
  const people = /** @type {any} */ ({ title: "Scattered 21 \u00d7 21", most_behind: 100, you: { missing: 3, comparing: 0 } });
  const of = (changes, board = people) => rankedText(task, /** @type {any} */ ({ episodes: [{ episode: "e", kind: "ranked", counts: true, place: people.title, outcome: "collided", ...changes }] }), "e", board);
  const left = "3 more ranked terrains, and you have a place among people.";
  assert.equal(of({}), `On the leaderboard this terrain counts 100 moves behind Expert, if Expert finishes it. ${left}`);
  assert.equal(of({ outcome: "explored" }), left);
  assert.equal(of({ outcome: "explored" }, { ...people, you: { missing: 0, comparing: 0 } }), "");
  for (const other of [{ counts: false }, { kind: "practice" }, { place: "Cave 21 \u00d7 21" }]) assert.equal(of(other), "");
});

test("a ranked end counts the terrains that wait for Expert", () => {
  const of = (missing, comparing, changes = {}) => rankedText(task, /** @type {any} */ ({ episodes: [{ episode: "e", kind: "ranked", counts: true, place: "Cave", outcome: "explored", not_attested: null, ...changes }] }), "e", /** @type {any} */ ({ title: "Cave", most_behind: 100, you: { missing, comparing } }));
  assert.equal(of(5, 1), "4 more ranked terrains, and you have a place among people.", "after the first");
  assert.equal(of(2, 2), "You have a place among people once Expert has finished your terrains.");
  assert.equal(of(0, 1), "", "who has a place keeps it");
  assert.equal(of(0, 0, { not_attested: "no key" }), "On the leaderboard this terrain counts 100 moves behind Expert, if Expert finishes it.", "a spoilt success");
});
