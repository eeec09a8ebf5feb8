import assert from "node:assert/strict";
import { test } from "node:test";
import { expectedOf, mostExpected, nextLooks, tint } from "../../../../static/task/mars/thoughts.js";
import { apply, initialState } from "../../../../static/common/game_state.js";
import { taskOf } from "../../../../static/task/mars/index.js";
import { policyBoards, stripTicks, valueLine } from "../../../../static/task/mars/thinking.js";

const frame = (rest = {}) => ({ kind: "frame", episode: "e1", step: 0, rows: 2, cols: 3, grid: [".@#", "..?"], position: [0, 1], discovered: 5,
  coverage: 0.8, heading: "east", reward: 0, return: 0, score: 0, outcome: null, ...rest });
const expected = (rest = {}) => ({ kind: "expected", episode: "e2", step: 0, cells: [[0, 0, 2], [1, 1, 7]], ...rest });
const about = { task: taskOf(), session: "s1", player: "human", level: "random", size: [2, 3], counts: false, frame: frame(),
  rival: { session: "s2", policy: "ppo", pace: { kind: "pace", mode: "follow", moves_per_second: 8 }, frame: frame({ episode: "e2" }) } };
const receive = (state, message) => apply(state, { kind: "received", role: "rival", message });

test("what is expected belongs to a policy's running episode, and waits for the next answer", () => {
  let state = receive(apply(initialState(), { kind: "begun", about }), expected());
  assert.equal(mostExpected(expectedOf(state.rival)), 7);
  assert.equal(receive(state, expected({ episode: "old" })).rival, state.rival);
  state = receive(state, frame({ episode: "e2", step: 1 }));
  assert.equal(expectedOf(state.rival).step, 0, "no flicker between two moves");
  assert.equal(expectedOf(receive(state, frame({ episode: "e2", step: 2, outcome: "explored" })).rival), null);
  assert.equal(expectedOf(receive(state, frame({ episode: "e3" })).rival), null);
});

test("each next move says what it should show; rocks and the edge are no move", () => {
  assert.equal(nextLooks(frame(), expected()), "\u2193\u202f7  \u2190\u202f2");
  assert.equal(nextLooks(frame({ position: [1, 1], grid: ["..#", ".@?"] }), expected()), "\u2191\u202f0  \u2192\u202f0  \u2190\u202f0");
  assert.ok(tint(1, 40) < tint(20, 40) && tint(20, 40) < tint(40, 40) && tint(40, 40) < 1);
});

test("a person's board is never a policy's", () => {
  const state = apply(initialState(), { kind: "begun", about });
  assert.deepEqual(policyBoards(state).map(([role]) => role), ["rival"]);
  assert.deepEqual(policyBoards({ ...state, mode: "watch" }).map(([role]) => role), ["player", "rival"]);
});

test("the strip has a number at each end, and nought between them where there is room", () => {
  assert.deepEqual(stripTicks([-7.2, 3.1]), [-5, 0]);
  assert.deepEqual(stripTicks([-20, 20]), [-20, 0, 20]);
  assert.deepEqual(stripTicks([2, 9]).length, 2);
  assert.match(valueLine(["ppo"]), /^What Expert expects to earn from here on/);
  assert.equal(valueLine([]), "");
});
