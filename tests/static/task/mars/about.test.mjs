// What the pages about the rules and about studies say, without a page.
import assert from "node:assert/strict";
import { test } from "node:test";
import { boardLine } from "../../../../static/task/mars/about.js";
import { joinable, lengthLine } from "../../../../static/studies/words.js";

test("a board is said in moves and in whole percent, never rounded up", () => {
  const board = { actions: Array(24).fill(1), outcome: "running", coverage: 0.4599 };
  assert.equal(boardLine("way", board), "45\u00a0% is known after 24 moves. The line is the path.");
  assert.equal(boardLine("crash", { ...board, outcome: "collided" }), "Crashed at 45\u00a0% after 24 moves.");
  assert.match(boardLine("start", { ...board, actions: [], coverage: 0.077 }), /first 7\u00a0%/);
});

test("only open studies that are open to everybody are listed", () => {
  const study = (name, status, recruitment) => ({ name, title: name, status, recruitment, warm_up: 15, ranked: 30 });
  const listed = [study("a", "open", "open"), study("b", "closed", "open"), study("c", "open", "invitation"), study("d", "open", "panel")];
  assert.deepEqual(joinable(listed).map(({ name }) => name), ["a"]);
  assert.equal(lengthLine(listed[0]), "15 episodes to warm up, then 30 that count");
  assert.equal(lengthLine({ warm_up: 1, ranked: 1 }), "1 episode to warm up, then 1 that counts");
});
