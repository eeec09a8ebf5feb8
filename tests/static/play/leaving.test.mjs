import assert from "node:assert/strict";
import test from "node:test";
import { isSameBoard, isUnfinished } from "../../../static/play/leaving.js";
import { watchedBoard, watchedName } from "../../../static/play/watching.js";

const frame = (changes = {}) => ({ kind: "frame", episode: "e1", step: 2, rows: 9, cols: 12, grid: [], position: [0, 0], discovered: 3, outcome: null, ...changes });
const state = (changes = {}) => ({ mode: "ranked", counts: true, level: "random", player: { frame: frame() }, ...changes });

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

test("a watched episode is a board: as it stands while it runs, then at any step of its replay", () => {
  const history = { positions: [[0, 0], [1, 0], [0, 0]], discovered: [1, 2, 3] };
  const live = { episode: "e1", player: "human", level: "random", size: [9, 12], frame: frame(), history, frames: null };
  assert.deepEqual(watchedBoard(live, 0).trail, history.positions);
  const frames = [0, 1, 2].map((step) => frame({ step, position: history.positions[step], discovered: step + 1 }));
  const board = watchedBoard({ ...live, frames }, 1);
  assert.deepEqual([board.frame.step, board.trail.length, board.session], [1, 2, "e1"]);
  assert.deepEqual(["human", "script", "ppo"].map(watchedName), ["Somebody", "A script", "ppo"]);
});
