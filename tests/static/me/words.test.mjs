import assert from "node:assert/strict";
import test from "node:test";
import { taskOf } from "../../../static/task/mars/index.js";
import { bestText, standingText, summary, terrainText } from "../../../static/me/words.js";

const task = taskOf();
const best = { level: "random", rows: 21, cols: 42, max_steps: 882, episodes: 4, explored: 3, best: null, people: { means: [80, 90.5, 120], you: 90.5, ranked: 2 } };

test("a player's place is among the people, by their mean", () => {
  assert.equal(standingText(best), "You need 90.5 moves on average, over 2 ranked episodes: place 2 of 3 people. A terrain that was not finished counts the limit.");
  assert.match(standingText({ ...best, people: { means: [80], you: 80, ranked: 1 } }), /only person so far/);
  assert.match(standingText({ ...best, people: { means: [80], you: null, ranked: 0 } }), /^1 person played this ranked\./);
  assert.match(standingText({ ...best, people: { means: [], you: null, ranked: 0 } }), /could be the first/);
});

test("the page says in a sentence what was driven", () => {
  assert.match(summary(task, { total: 0, episodes: [], bests: [] }), /once you have played/);
  assert.equal(summary(task, { total: 5, episodes: [], bests: [best] }), "You have driven 5 episodes in this browser, and mapped 3 terrains to 99 %.");
  assert.equal(bestText(task, { ...best, best: {} }), "75 % of 4 episodes mapped to 99 %.");
  assert.match(bestText(task, { ...best, explored: 0 }), /No terrain/);
  assert.equal(terrainText(best), "random 21 \u00d7 42");
  assert.equal(task.outcome("collided"), "crashed");
});
