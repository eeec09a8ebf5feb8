import assert from "node:assert/strict";
import test from "node:test";
import { comparingText, emptyText, missingText } from "../../../static/leaderboard/people.js";

test("what is empty says what fills it, and how far somebody is from a place", () => {
  assert.match(emptyText("week", { you: null }), /^Nobody .* in the last seven days\. Play ranked: 5 terrains,/);
  assert.match(emptyText("all", { you: { terrains: 4, missing: 1 } }), /^Nobody .* yet\. Play ranked: 1 terrain more,/);
  assert.equal(missingText("all", { terrains: 1, missing: 4 }), "You have 1 ranked terrain: 4 more, and you stand here.");
  assert.equal(missingText("week", { terrains: 0, missing: 5 }), "You have 0 ranked terrains in the last seven days: 5 more, and you stand here.");
  assert.equal(comparingText(1), "Expert drives on 1 more terrain to compare. The figures follow.");
  assert.equal(comparingText(0), "");
});
