// The leaderboard's words, order and scales, without a page.
import assert from "node:assert/strict";
import { test } from "node:test";
import { breakOf, footing, heat, inWords, placeOf, scaleOf, topOf } from "../../../static/leaderboard/ranks.js";
import { tickText, ticks } from "../../../static/common/chart_scale.js";
import { taskOf } from "../../../static/task/mars/index.js";
import { MARS } from "../task/mars/about.mjs";
import { coverageEnd, curveText, headline, ranksNote, reading, rows, working } from "../../../static/leaderboard/standing.js";

const task = taskOf(MARS);
const interval = (mean, half = null) => ({ mean, low: half === null ? null : mean - half, high: half === null ? null : mean + half });
const figure = (steps, score, half = 2) => ({ episodes: 100, score: interval(score, 0.01), steps: interval(steps, half), completed: 1, curve: null, visits: null });
const ready = (name, steps, score) => ({ name, state: "ready", done: 100, of: 100, figure: figure(steps, score), error: null });
const waiting = (name) => ({ name, state: "waiting", done: 0, of: 100, figure: null, error: null });
const board = { id: "random-21x21", title: "", study: null, place: "Scattered 21 \u00d7 21", max_steps: 441, terrains: 100, players: 7, episodes: 40, missing: null };
const people = { ...figure(90, 0.9), players: 5, episodes: 38, trials: [] };

test("the best stands first by either measure, whoever has no figure last", () => {
  const detail = { board, people, policies: [waiting("frontier-cost"), ready("ppo", 78, 0.95), ready("random", 441, 0.2)] };
  assert.deepEqual(rows(task, detail, "steps").map(({ name }) => name), ["ppo", "Volunteers", "random", "frontier-cost"]);
  assert.deepEqual(rows(task, detail, "score").map(({ name }) => name), ["ppo", "Volunteers", "random", "frontier-cost"]);
  assert.deepEqual(rows(task, { ...detail, people: null }, "steps").map(({ name }) => name), ["ppo", "random", "frontier-cost"]);
});

test("the scale holds whoever is near the best; who is far out stands beyond a break", () => {
  const scale = scaleOf([figure(78, 0.95), figure(90, 0.94), figure(441, 0.2)], "steps");
  assert.ok(scale.near.low < 76 && scale.near.high > 92 && scale.near.high < 110);
  assert.ok(scale.ticks.every((tick) => tick >= scale.near.low && tick <= scale.near.high));
  assert.deepEqual(scale.farTicks, [441]);
  const [best, next, far] = [78, 90, 441].map((steps) => placeOf(scale, steps));
  const gap = breakOf(scale);
  assert.ok(0 < best && best < next && next < gap.from && gap.to < far && far < 1);
  assert.equal(placeOf(scale, 200), null, "nothing stands in the break");
  const score = scaleOf([figure(78, 0.95), figure(90, 0.94), figure(441, 0.2), figure(441, 0.6)], "score");
  assert.deepEqual(score.farTicks, [0.2, 0.6]);
  assert.ok(placeOf(score, 0.2) < placeOf(score, 0.6) && placeOf(score, 0.6) < breakOf(score).from && placeOf(score, 0.94) > breakOf(score).to);
  const near = scaleOf([figure(78, 0.95), figure(90, 0.94)], "steps");
  assert.equal(breakOf(near), null);
  assert.deepEqual([near.near.from, near.near.to], [0, 1]);
  assert.deepEqual(scaleOf([], "steps").ticks, []);
});

test("the note under the ranks speaks of what is drawn and of nothing else", () => {
  const origin = { command: "humanplay leaderboard" };
  const came = { ...ready("ppo", 78, 0.95), shipped: origin };
  assert.equal(ranksNote(task, { board, people: null, policies: [ready("ppo", 78, 0.95)] }, false), "");
  assert.match(ranksNote(task, { board, people, policies: [] }, false), /^The dashed line is the mean of the volunteers\.$/);
  assert.match(ranksNote(task, { board, people: null, policies: [came] }, true), /^The axis is broken .* The policies' figures come with MarsExplorer\.$/);
  assert.match(ranksNote(task, { board, people: null, policies: [came, waiting("mine")] }, false), /^The figures of Expert come with/);
});

test("ticks are round and few", () => {
  assert.deepEqual(ticks(72, 118), [80, 90, 100, 110]);
  assert.deepEqual(ticks(0, 100), [0, 20, 40, 60, 80, 100]);
  assert.equal(tickText(0.945), "0.945");
  assert.equal(tickText(-0.1), "\u22120.1");
});

test("honest words when nobody has played, too few for a mean, and enough", () => {
  const policies = [ready("ppo", 78, 0.95)];
  const of = (changes) => headline(task, { board: { ...board, ...changes }, people: null, policies });
  assert.match(of({ players: 0, episodes: 0 }), /^Volunteers on this playground, Scattered 21 \u00d7 21: nobody has played this ranked yet\. The best policy, Expert, takes 78\.0/);
  const few = [[1, 1, 5, "1 player and 1 ranked episode so far", "5 are missing"], [6, 26, 1, "6 players and 26 ranked episodes so far", "1 is missing"]];
  for (const [players, episodes, missing, so_far, lacks] of few) {
    const text = of({ players, episodes, missing: { players: missing, of: 5, episodes: 5 } });
    assert.ok(text.includes(`: ${so_far}, and no mean yet. It needs 5 players with 5 ranked episodes each: ${lacks}. The best policy`), text);
    assert.doesNotMatch(text, /moves to 99|interval/);
  }
  const claim = "Human level";
  assert.match(headline(task, { board: { ...board, study: "dunes" }, people: { ...people, claim, players: 1, steps: interval(90) }, policies }), /\(no interval: fewer than five players\), from 1 player and/);
  assert.match(headline(task, { board, people: { ...people, players: 5, steps: interval(441) }, policies }), /\(no interval: these players do not differ\), from 5/);
  assert.match(headline(task, { board, people, policies }), /^Volunteers on this playground, Scattered 21 \u00d7 21: 90\.0 moves to 99 % \(95 % interval 88\.0 to 92\.0\), from 5 players and 38 episodes; 2 players with fewer episodes are not in it\. The best policy, Expert, takes 78\.0/);
  assert.doesNotMatch(headline(task, { board, people, policies: [...policies, waiting("frontier-cost")] }), /best policy/, "not before all are known");
});

test("a study's board says so, and who enters it", () => {
  const study = { ...board, study: "dunes", terrains: 30 };
  const policies = [ready("ppo", 78, 0.95)];
  assert.match(headline(task, { board: study, people: { ...people, claim: "Human level (supervised)" }, policies }), /^Human level \(supervised\) in the study dunes, Scattered 21 \u00d7 21: 90\.0/);
  assert.deepEqual(rows(task, { board: study, people, policies }, "steps").map(({ name }) => name), ["ppo", "People"]);
  assert.match(headline(task, { board, people: { ...people, abandoned: 2 }, policies }), /38 episodes, 2 of them abandoned; 2 players/);
  assert.doesNotMatch(headline(task, { board, people, policies }), /human level/i, "that is a closed study's figure alone");
  assert.match(headline(task, { board: study, people: null, policies }), /^No person finished the study dunes, so it has no human score/);
  assert.match(reading(task, { board: study, people: { ...people, set: "per protocol" }, policies })[0], /who finished as its protocol asks/);
  const both = { ...people, set: "per protocol", everybody: { players: 3, steps: { mean: 99 } } };
  assert.match(headline(task, { board: study, people: both, policies }), /Everybody who began \(3 players\): 99\.0 moves\./);
  assert.match(reading(task, { board: study, people, policies })[1], /exactly the study.s 30 ranked terrains/);
  assert.match(reading(task, { board, people, policies })[1], /100 fixed terrains/);
});

test("what is being evaluated is said, and nothing once all is done", () => {
  assert.equal(working(task, [ready("ppo", 78, 0.9)]), null);
  const busy = working(task, [ready("ppo", 78, 0.9), { ...waiting("frontier-cost"), state: "computing", done: 20 }, waiting("random")]);
  assert.deepEqual([busy.done, busy.of], [120, 300]);
  assert.match(busy.text, /Evaluating 2 policies: Nearest plays terrain 21 of 100/);
});

test("the axis of coverage ends where the last who finishes is done", () => {
  const done = { steps: [0, 50, 100], mean: [0.1, 0.9, 0.99], low: [], high: [] };
  const never = { steps: [0, 441], mean: [0.1, 0.6], low: [], high: [] };
  assert.equal(coverageEnd([done, never]), 120);
  assert.equal(coverageEnd([never]), 500);
  assert.match(curveText("ppo", done), /50 percent after 50 moves, 90 percent after 50 moves; 99\.0 percent in the end/);
});

test("heat rises in lightness all the way, and the scale is not a random walk's", () => {
  const light = [0, 0.25, 0.5, 0.75, 1, 2].map((share) => heat(share).reduce((a, b) => a + b, 0));
  assert.deepEqual(light, [...light].sort((a, b) => a - b));
  assert.equal(topOf([{ name: "random", visits: [[9, 9]] }, { name: "ppo", visits: [[1, 2]] }]), 2);
  assert.match(inWords([[4, 0], [0, 0]]), /100 percent in the north-west, 0 percent in the north-east/);
});

test("later points that rest on fewer people say so", () => {
  const trial = (number, players) => ({ trial: number, players, score: interval(1), steps: interval(1) });
  assert.match(footing([trial(1, 6), trial(2, 1)]), /6 players in the first episode, 1 player in episode 2: the later points rest on fewer/);
  assert.doesNotMatch(footing([trial(1, 2), trial(2, 2)]), /fewer/);
});

test("a policy that knows how terrains are made is not what people are compared with", () => {
  const policies = ["lookahead", "ppo"].map((name, at) => ({ name, state: "ready", figure: { steps: { mean: 60 + at } } }));
  const detail = { board: { study: null, place: "Scattered 21 \u00d7 21" }, people: null, policies };
  assert.match(headline(task, detail), /The best policy that does not know how terrains are made, Expert, takes 61/);
  assert.deepEqual(rows(task, detail, "steps").map(({ name }) => name), ["lookahead", "ppo"]);
});
