import assert from "node:assert/strict";
import test from "node:test";
import { boardAt } from "../../../static/common/replay.js";
import * as replays from "../../../static/study/replay.js";

const frame = (changes = {}) => ({ kind: "frame", episode: "e1", step: 0, rows: 2, cols: 3, grid: ["@.?", "#??"], position: [0, 0],
  discovered: 3, coverage: 0.5, heading: "east", reward: null, return: null, score: null, outcome: null, ...changes });

test("the replay plays both runs in step, stops at the longer one's end and begins again", () => {
  const run = (count) => Array.from({ length: count }, (_, step) => frame({ step, discovered: step }));
  let replay = replays.toggled(replays.begun(0, { own: run(2), policy: { name: "ppo", frames: run(4) } }));
  for (let k = 0; k < 5; k++) replay = replays.stepped(replay);
  assert.deepEqual([replay.step, replay.isPlaying], [3, false]);
  assert.deepEqual(boardAt(replay.runs.own, "You", replay.step).discovered, [0, 1]);
  assert.equal(replays.toggled(replay).step, 0);
  assert.deepEqual([replays.moved(replay, 99).step, replays.moved(replay, -1).step], [3, 0]);
  assert.equal(boardAt([], "x", 0), null);
});
