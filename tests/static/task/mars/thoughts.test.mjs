import assert from "node:assert/strict";
import { test } from "node:test";
import { taskOf } from "../../../../static/task/mars/index.js";
import { goalText, thoughtOf, wedges } from "../../../../static/task/mars/thoughts.js";
import { apply, ghostOf, initialState } from "../../../../static/common/game_state.js";

const frame = (rest = {}) => ({ kind: "frame", episode: "e1", step: 0, rows: 2, cols: 3, grid: ["@..", "???"], position: [0, 0], discovered: 3,
  coverage: 0.5, heading: "east", reward: 0, return: 0, score: 0, outcome: null, ...rest });
const thought = (rest = {}) => ({ kind: "thought", episode: "e1", step: 0, probabilities: [0, 0.7, 0.29, 0.01], value: 4.5, ...rest });
const about = (rest = {}) => ({ task: taskOf(), session: "s1", player: "human", level: "random", size: [2, 3], counts: false, frame: frame(),
  rival: { session: "s2", policy: "ppo", pace: { kind: "pace", mode: "follow", moves_per_second: 8 }, frame: frame({ episode: "e2" }) }, ...rest });
const begun = () => apply(initialState(), { kind: "begun", about: about() });
const receive = (state, role, message) => apply(state, { kind: "received", role, message });

test("a wedge points where the policy would go, and is as long as it is sure", () => {
  const [east, south] = wedges([0, 0.7, 0.3, 0], 10);
  assert.ok(east.points[0][0] > 0 && Math.abs(east.points[0][1]) < 1e-9);
  assert.ok(south.points[0][1] > 0 && Math.abs(south.points[0][0]) < 1e-9);
  assert.ok(east.points[0][0] > south.points[0][1]);
  assert.equal(wedges([0.01, 0.99, 0, 0], 10).length, 1);
  assert.equal(wedges([NaN, 1, 0, 0], 10).length, 1);
});

test("a thought is kept with its value at its step, and drawn with its own frame only", () => {
  let state = receive(begun(), "rival", thought({ episode: "e2" }));
  assert.equal(thoughtOf(state.rival).value, 4.5);
  assert.deepEqual(state.rival.values, [4.5]);
  state = receive(state, "rival", frame({ episode: "e2", step: 1, position: [0, 1] }));
  assert.equal(thoughtOf(state.rival), null);
  state = receive(state, "rival", thought({ episode: "e2", step: 1, value: null }));
  assert.deepEqual(state.rival.values, [4.5, null]);
  assert.ok(thoughtOf(state.rival));
  state = receive(state, "rival", frame({ episode: "e2", step: 2, outcome: "explored" }));
  assert.equal(thoughtOf({ ...state.rival, thought: thought({ episode: "e2", step: 2 }) }), null);
});

test("the cell that a policy heads for is said in words, with its name where there are two", () => {
  const goals = (role, goal) => thought({ episode: role === "rival" ? "e2" : "e1", probabilities: null, value: null, goal });
  const state = receive(receive(begun(), "rival", goals("rival", [1, 2])), "player", goals("player", [0, 1]));
  assert.equal(goalText([state.rival]), "row 1, column 2");
  assert.equal(goalText([state.player, state.rival]), "row 0, column 1 (You); row 1, column 2 (Expert)");
  assert.equal(goalText([receive(state, "rival", thought({ episode: "e2", goal: null })).rival]), "");
  assert.equal(goalText([receive(state, "rival", frame({ episode: "e2", step: 1 })).rival]), "", "the goal of the frame before");
});

test("a thought about another episode changes nothing, and the next episode forgets", () => {
  const state = receive(begun(), "rival", thought({ episode: "e2" }));
  assert.equal(receive(state, "rival", thought({ episode: "old", value: 9 })).rival, state.rival);
  const next = receive(state, "rival", frame({ episode: "e3" }));
  assert.equal(next.rival.thought, null);
  assert.deepEqual(next.rival.values, []);
});

test("ghosts appear on both boards when the player's episode is over, and not before", () => {
  let state = receive(begun(), "rival", frame({ episode: "e2", step: 1, position: [0, 1] }));
  assert.equal(ghostOf(state, "player"), null);
  assert.equal(ghostOf(state, "rival"), null);
  state = receive(state, "player", frame({ step: 1, position: [1, 0], outcome: "collided" }));
  assert.deepEqual(ghostOf(state, "player"), [[0, 0], [0, 1]]);
  assert.deepEqual(ghostOf(state, "rival"), [[0, 0], [1, 0]]);
  assert.equal(ghostOf({ ...state, rival: null }, "player"), null);
});
