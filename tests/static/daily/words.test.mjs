import assert from "node:assert/strict";
import test from "node:test";
import { taskOf } from "../../../static/task/mars/index.js";
import { countdown, dayText, peopleText, policyText, rankText, resultText, shareText, streakText } from "../../../static/daily/words.js";

const task = taskOf();
const explored = { state: "ended", episode: "e1", outcome: "explored", moves: 87, coverage: 0.9932, score: 0.9, unranked: null };
const crashed = { ...explored, outcome: "collided", moves: 16, coverage: 0.2857 };
const ppo = { name: "ppo", state: "ready", moves: 75, coverage: 0.99 };
const people = (you, players = 3) => ({ players, unfinished: 1, moves: [[87, 2]], table: [], you });

test("a shared text says the day, the result and the policy, and nothing else", () => {
  assert.equal(shareText(task, "2026-11-22", explored, [ppo], "http://here/daily"), "MarsExplorer daily 2026-11-22: 87 moves, 99.3 % mapped, Expert needed 75\nhttp://here/daily");
  assert.equal(shareText(task, "2026-11-22", crashed, [{ ...ppo, moves: null }], "x"), "MarsExplorer daily 2026-11-22: crashed at 28.5 % after 16 moves\nx");
});

test("each ending has words of its own", () => {
  const said = ["explored", "collided", "out_of_bounds", "timed_out", "abandoned"].map((outcome) => resultText(task, { ...crashed, outcome }));
  assert.equal(new Set(said).size, 5);
});

test("the rank names people and policies, or says why there is none", () => {
  const mine = { outcome: "explored", moves: 87, coverage: 0.99, you: true, rank: 2 };
  assert.equal(rankText(explored, people(mine), [ppo, { ...ppo, name: "slow", moves: 99 }]), "Rank 2 of 3 people today, and better than 1 of 2 policies.");
  assert.equal(rankText(explored, people(mine), [ppo]), "Rank 2 of 3 people today, and not better than any policy.");
  assert.equal(rankText(explored, people({ ...mine, rank: 1 }, 1), [{ ...ppo, moves: 90 }]), "You are the first person today, and better than every policy.");
  assert.equal(rankText(explored, people(mine), [{ ...ppo, state: "waiting", moves: null }]), "Rank 2 of 3 people today.");
  assert.match(rankText({ ...explored, unranked: "a move was a script's" }, people(null), [ppo]), /no rank: a move was a script's/);
});

test("times, days, streaks and counts are said as people say them", () => {
  assert.deepEqual([countdown(3_661_000), countdown(59_001), countdown(-5)], ["1:01:01", "0:01:00", "0:00:00"]);
  assert.equal(dayText("2026-11-02"), "2 November 2026");
  assert.deepEqual([streakText(0), streakText(1), streakText(3)], ["", "", "3 days in a row"]);
  assert.equal(peopleText(task, people(null)), "3 people; 1 of them did not reach 99 %. Each has one attempt.");
  assert.equal(peopleText(task, { ...people(null), players: 0 }), "Nobody has a rank yet.");
  assert.deepEqual([ppo, { ...ppo, moves: null, coverage: 0.56 }, { ...ppo, state: "waiting" }].map(policyText), ["75 moves", "stopped at 56.0 %", "still exploring"]);
});
