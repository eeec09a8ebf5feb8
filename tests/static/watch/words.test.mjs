// A watched episode in words, and on the page's state.
import assert from "node:assert/strict";
import test from "node:test";
import { apply, initialState } from "../../../static/common/game_state.js";
import { taskOf } from "../../../static/task/mars/index.js";
import { MARS } from "../task/mars/about.mjs";
import { endedLine, idInPath, liveHeadline, watchedName } from "../../../static/watch/words.js";

test("a watched episode is a board as it stands", () => {
  const history = { positions: [[0, 0], [1, 0], [0, 0]], discovered: [1, 2, 3] };
  const frame = { kind: "frame", episode: "e1", step: 2, cells: 9 };
  const watched = { episode: "e1", player: "human", level: "random", size: [9, 12], frame, history, frames: null, task: taskOf(MARS) };
  const { player: board } = apply(initialState(), { kind: "watched", watched, name: watchedName("human") });
  assert.deepEqual([board.session, board.name, board.trail.length, board.frame.step], ["e1", "Somebody", 3, 2]);
  assert.deepEqual(["you", "human", "script", "ppo"].map(watchedName), ["You", "Somebody", "A script", "ppo"]);
  assert.deepEqual(["you", "human", "Expert"].map(liveHeadline), ["Live: you are playing", "Live: somebody else is playing", "Live: Expert is playing"]);
  assert.deepEqual([endedLine("you", "terrain", false), endedLine("human", "terrain", false)], ["Its replay opens once the day is over.", ""]);
});

test("the address names the episode, also under a prefix", () => {
  assert.deepEqual(["/watch/00ff00ff", "/mars/watch/00ff00ff", "/watch/", "/watch/<b>"].map(idInPath), ["00ff00ff", "00ff00ff", null, null]);
});
