import assert from "node:assert/strict";
import test from "node:test";
import { taskOf } from "../../../static/task/mars/index.js";
import { MARS } from "../task/mars/about.mjs";
import { bestRows, countdown, dayText, peopleText, policyRows, policyText, rankText, resultText, shareText, shownRows, streakText, pillText, whoText } from "../../../static/daily/words.js";

const task = taskOf(MARS);
const explored = { state: "ended", episode: "e1", outcome: "explored", moves: 87, coverage: 0.9932, score: 0.9, unranked: null };
const crashed = { ...explored, outcome: "collided", moves: 16, coverage: 0.2857 };
const ppo = { name: "ppo", state: "ready", moves: 75, coverage: 0.99 };
const people = (you, players = 3) => ({ players, unfinished: 1, moves: [[87, 2]], table: [], you });

test("a shared text says the day, the result and the policy, and nothing else", () => {
  assert.equal(shareText(task, "2026-11-22", explored, [ppo], "http://here/daily"), "MarsExplorer daily 2026-11-22: 87 moves, 99.3 % mapped, Expert needed 75\nhttp://here/daily");
  assert.equal(shareText(task, "2026-11-22", crashed, [{ ...ppo, moves: null }], "x"), "MarsExplorer daily 2026-11-22: crashed with 28.5 % mapped after 16 moves\nx");
});

test("people who are level share a row, which leads to one's own replay", () => {
  const person = (rank, moves, you = false, episode = `e${rank}${moves}${you}`) => ({ rank, moves, you, episode, outcome: "explored", coverage: 0.99 });
  const crashed = { rank: 5, moves: null, you: false, episode: null, outcome: "abandoned", coverage: 0.09 };
  const rows = bestRows(task, [person(1, 99), person(1, 99), person(1, 99, true, "mine"), person(4, 101), crashed]);
  assert.deepEqual(rows.map(whoText), ["1. You and 2 people", "4. A person", "5. A person"]);
  assert.deepEqual(rows.map(({ episode }) => episode), ["mine", "e4101false", null]);
  assert.deepEqual(bestRows(task, [person(1, 99), person(1, 99)]).map(whoText), ["1. 2 people"]);
  assert.deepEqual(bestRows(task, [person(1, 99, true)]).map(whoText), ["1. You"]);
});

test("each ending has words of its own", () => {
  const said = ["explored", "collided", "out_of_bounds", "timed_out", "abandoned"].map((outcome) => resultText(task, { ...crashed, outcome }));
  assert.equal(new Set(said).size, 5);
});

test("the rank counts the very policies that are listed", () => {
  const mine = (moves) => ({ outcome: "explored", moves, coverage: 0.99, you: true, rank: 2 });
  const named = (name, moves, state = "ready") => ({ name, moves, state, coverage: 0.9 });
  const seven = ["ppo", "frontier-cost", "frontier-utility", "frontier-priced", "mine", "lookahead", "random"].map((name, at) => named(name, name === "random" ? null : 70 + at));
  const cases = [
    [seven, 72, "better than 4 of 7 policies"], [seven, 60, "better than all 7 policies"], [seven, 76, "better than 1 of 7 policies"],
    [seven, null, "better than none of 7 policies"], [[named("ppo", 80)], 70, "better than the one policy"],
    [[named("ppo", 70)], 70, "not better than the one policy"], [[named("ppo", 80), named("slow", null, "waiting")], 70, "better than the one policy that is ready"],
    [[...seven, named("slow", null, "computing"), named("gone", null, "failed")], 72, "better than 4 of 7 policies that are ready"],
  ];
  for (const [policies, moves, said] of cases) {
    const rows = policyRows(task, policies, moves);
    assert.deepEqual(rows.map(({ name, text }) => [name, text]), policies.map((policy) => [task.nameOf(policy.name), policyText(task, policy)]));
    assert.equal(rankText(explored, people(mine(moves)), rows), `Rank 2 of 3 people today, and ${said}.`);
  }
});

test("the rank names people and policies, or says why there is none", () => {
  const rowsOf = (...policies) => policyRows(task, policies, 87);
  const mine = { outcome: "explored", moves: 87, coverage: 0.99, you: true, rank: 2 };
  assert.equal(rankText(explored, people(mine), rowsOf(ppo, { ...ppo, name: "slow", moves: 99 })), "Rank 2 of 3 people today, and better than 1 of 2 policies.");
  assert.equal(rankText(explored, people(mine), rowsOf(ppo)), "Rank 2 of 3 people today, and not better than the one policy.");
  assert.equal(rankText(explored, people({ ...mine, rank: 1 }, 1), rowsOf({ ...ppo, moves: 90 })), "You are the first person today, and better than the one policy.");
  assert.equal(rankText(explored, people(mine), rowsOf({ ...ppo, state: "waiting", moves: null })), "Rank 2 of 3 people today.");
  assert.match(rankText({ ...explored, unranked: "a move was a script's" }, people(null), rowsOf(ppo)), /no rank: a move was a script's/);
});

test("policies that still play share one row", () => {
  const rowsOf = (...states) => shownRows(policyRows(task, states.map((state) => ({ ...ppo, state })), 87)).map(({ name, text }) => `${name}: ${text}`);
  assert.deepEqual(rowsOf("waiting", "ready", "computing", "waiting"), ["Expert: 75 moves", "3 policies: still playing"]);
  assert.deepEqual(rowsOf("ready", "waiting"), ["Expert: 75 moves", "Expert: still playing"]);
});

test("times, days, streaks and counts are said as people say them", () => {
  assert.deepEqual([countdown(3_661_000), countdown(59_001), countdown(-5)], ["1:01:01", "0:01:00", "0:00:00"]);
  assert.equal(dayText("2026-11-02"), "2 November 2026");
  assert.deepEqual([streakText(0), streakText(1), streakText(3)], ["", "", "3 days in a row"]);
  assert.equal(peopleText(task, people(null)), "3 people; 1 of them did not reach 99 %. Each has one attempt.");
  assert.equal(peopleText(task, { ...people(null), players: 0 }), "Nobody has a rank yet.");
  assert.deepEqual([ppo, { ...ppo, moves: null, coverage: 0.56 }, { ...ppo, state: "waiting" }].map((policy) => policyText(task, policy)), ["75 moves", "stopped with 56.0 % mapped", "still playing"]);
});

test("the link to the daily page says how today stands", () => {
  assert.equal(pillText(task, { attempt: null, players: 14, streak: 3 }), "not played \u00b7 14 people \u00b7 streak 3");
  assert.equal(pillText(task, { attempt: { state: "open" }, players: 1, streak: 1 }), "begun \u00b7 1 person");
  const attempt = { state: "ended", outcome: "explored", moves: 71 };
  assert.equal(pillText(task, { attempt, players: 0, streak: 0 }), "71 moves \u00b7 0 people");
  assert.equal(pillText(task, { attempt: { ...attempt, outcome: "collided" }, players: 2, streak: 0 }), "played \u00b7 2 people");
});
