import assert from "node:assert/strict";
import test from "node:test";
import { taskOf } from "../../../static/task/mars/index.js";
import { MARS } from "../task/mars/about.mjs";
import { comparingText, emptyText, fillingText, placeText } from "../../../static/leaderboard/people.js";

const task = taskOf(MARS);

test("what is empty says what fills it, and how far somebody is from a place", () => {
  assert.match(emptyText(task, "week", { fewest: 6, you: null }), /^Nobody has 6 ranked terrains in the last seven days\. Play ranked: 6 terrains,/);
  assert.match(emptyText(task, "all", { fewest: 5, you: { terrains: 4, missing: 1 } }), /^Nobody .* yet\. Play ranked: 1 terrain more,/);
  const of = (you) => placeText(task, /** @type {any} */ ({ fewest: 5, ranked: 7, comparing: 9, you: you && { comparing: 0, ...you } }));
  assert.equal(of({ terrains: 9, missing: 0, place: 4 }), "You are 4 of 7 people.");
  assert.equal(of({ terrains: 1, missing: 4 }), "4 more ranked terrains, and you have a place.");
  assert.equal(of({ terrains: 0, missing: 5 }), "5 ranked terrains, and you have a place.");
  assert.equal(of(null), "5 ranked terrains, and you have a place.");
  assert.equal(of({ terrains: 0, missing: 5, comparing: 1 }), "Not all of your terrains are compared with Expert yet.");
  assert.equal(comparingText(task, 1, true), "Expert plays 1 more terrain to compare. The figures follow.");
  assert.equal(comparingText(task, 32, false), "Expert plays 32 more terrains to compare.");
  assert.equal(comparingText(task, 0, true), "");
  assert.equal(fillingText(task, 5), "Play 5 ranked terrains, and you have a place here.");
});
