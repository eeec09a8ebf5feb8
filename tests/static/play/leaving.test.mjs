import assert from "node:assert/strict";
import test from "node:test";
import { isSameBoard, isUnfinished, showInstead } from "../../../static/play/sessions.js";

const frame = (changes = {}) => ({ kind: "frame", episode: "e1", step: 2, rows: 9, cols: 12, grid: [], position: [0, 0], discovered: 3, outcome: null, ...changes });
const task = { shape: ({ rows, cols }) => [cols, rows] };
const state = (changes = {}) => ({ task, mode: "ranked", counts: true, level: "random", player: { frame: frame() }, ...changes });

test("leaving costs something only in a ranked episode with moves that counts and has not ended", () => {
  assert.equal(isUnfinished(state()), true);
  assert.equal(isUnfinished(state({ player: { frame: frame({ step: 0 }) } })), false);
  assert.equal(isUnfinished(state({ player: { frame: frame({ outcome: "explored" }) } })), false);
  assert.equal(isUnfinished(state({ counts: false })), false);
  assert.equal(isUnfinished(state({ mode: "practice" })), false);
  assert.equal(isUnfinished(state({ player: null })), false);
});

test("asking for the very board that is open leaves nothing", () => {
  const wish = { level: "random", size: [9, 12], seed: null, rival: "ppo", player: "ppo" };
  assert.equal(isSameBoard(state(), "ranked", wish), true);
  assert.equal(isSameBoard(state(), "practice", wish), false);
  assert.equal(isSameBoard(state(), "ranked", { ...wish, seed: 3 }), false);
  assert.equal(isSameBoard(state(), "ranked", { ...wish, size: 9 }), false);
  assert.equal(isSameBoard(state(), "ranked", { ...wish, level: "2-1-1" }), false);
});

test("a link to somebody else's episode leads to its live view, and to nowhere when there is none", async () => {
  /** @type {string[]} */
  const gone = [];
  const place = { replace: (url) => gone.push(url) };
  await assert.rejects(showInstead("e1", () => Promise.reject(new Error("404")), place));
  assert.deepEqual(gone, []);
  await showInstead("e 1", async () => ({}), place);
  assert.deepEqual(gone, ["watch/e%201"]);
});
