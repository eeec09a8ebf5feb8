import assert from "node:assert/strict";
import test from "node:test";
import { taskOf } from "../../../static/task/mars/index.js";
import { MARS } from "../task/mars/about.mjs";
import { apply, goesOn, initialState, isDriving, knowsTheEnd, screenOf } from "../../../static/study/state.js";

const frame = (changes = {}) => ({ kind: "frame", episode: "e1", step: 0, rows: 2, cols: 3, grid: ["@.?", "#??"], position: [0, 0],
  discovered: 3, coverage: 0.5, heading: "east", reward: null, return: null, score: null, outcome: null, ...changes });
const task = taskOf(MARS);
const about = (changes = {}) => ({ task, session: "s1", player: "human", level: "random", size: [2, 3], counts: false, rival: null, frame: frame(changes) });
const participant = (changes = {}) => ({ study: "demo", title: "Demo", participant: "P-1", stage: "ranked", consent: { version: "1", text: "a\n\nb" }, questions: [],
  right: null, warm_up: { done: 1, of: 1 }, ranked: { done: 0, of: 2 }, tutorial: { done: true }, break_due: false, can_be_erased: true, pause_after_s: 60, session: null, about: null,
  phase: null, settings: {}, debrief: null, ...changes });
const standing = (changes) => apply(initialState(), { kind: "participant", participant: participant(changes) });
const playing = (changes = {}, of = {}) => standing({ session: "s1", phase: "ranked", about: about(changes), ...of });
const receive = (state, changes) => apply(state, { kind: "received", role: "player", message: frame(changes) });

test("the screen follows the stage, and the board stands before it while it is driven", () => {
  assert.equal(screenOf(initialState()), "loading");
  for (const stage of ["consent", "instructions", "questions", "debrief", "complete", "withdrawn"]) assert.equal(screenOf(standing({ stage })), stage);
  for (const stage of ["tutorial", "warm_up", "ranked"]) assert.equal(screenOf(standing({ stage })), "ready");
  assert.equal(screenOf(standing({ break_due: true })), "break");
  const back = apply(standing({ stage: "complete" }), { kind: "looked-back", looksBack: true });
  assert.equal(screenOf(back), "debrief", "whoever has finished may look at the debrief again");
  assert.equal(screenOf(apply(back, { kind: "looked-back", looksBack: false })), "complete");
  assert.equal(screenOf(playing()), "play");
  assert.equal(screenOf(apply(playing(), { kind: "problem", text: "no" })), "problem");
});

test("an ended episode keeps its card until it is passed, over the change of stage too, and not a stage longer", () => {
  const ended = playing({ outcome: "collided" }, { phase: "warm_up" });
  assert.equal(screenOf(ended), "play");
  assert.equal(isDriving(ended), false);
  assert.equal(screenOf(apply(ended, { kind: "passed", episode: "e1" })), "ready");
  assert.equal(screenOf(playing({ outcome: "explored" }, { phase: "ranked", stage: "debrief" })), "play");
  assert.equal(screenOf(playing({ outcome: "explored" }, { phase: "ranked", stage: "complete" })), "complete");
  assert.equal(screenOf(playing({ outcome: "explored" }, { phase: "tutorial", stage: "questions" })), "questions");
  assert.equal(screenOf(playing({}, { phase: "ranked", stage: "withdrawn" })), "withdrawn");
});

test("the next terrain follows at once only within a stage and without a break", () => {
  assert.equal(goesOn(participant({ phase: "ranked" })), true);
  assert.equal(goesOn(participant({ phase: "ranked", break_due: true })), false);
  assert.equal(goesOn(participant({ phase: "warm_up" })), false);
});

test("the end is known once the server's answer holds it", () => {
  const ended = receive(playing(), { step: 1, outcome: "collided" });
  assert.equal(knowsTheEnd(ended), false);
  assert.equal(knowsTheEnd(apply(ended, { kind: "participant", participant: participant({ phase: "ranked", about: about({ step: 1, outcome: "collided" }) }) })), true);
});

test("another tab's frames drive this board as well", () => {
  const one = receive(playing(), { step: 1, position: [0, 1] });
  assert.deepEqual(one.game.player.trail, [[0, 0], [0, 1]]);
  assert.equal(screenOf(receive(one, { episode: "e2" })), "play");
});

test("a pause ends with its episode", () => {
  const paused = apply(playing(), { kind: "paused", isPaused: true });
  assert.equal(paused.isPaused, true);
  assert.equal(receive(paused, { step: 1, outcome: "abandoned" }).isPaused, false);
  assert.equal(apply(standing({}), { kind: "paused", isPaused: true }).isPaused, false);
});

test("apply leaves the state before as it was", () => {
  const before = Object.freeze(playing());
  Object.freeze(before.game);
  apply(before, { kind: "participant", participant: participant({ stage: "complete" }) });
  assert.equal(screenOf(before), "play");
});

test("a closed study says so in the place of the screen, and one who left reads what is kept", () => {
  assert.equal(screenOf(standing({ note: "closed" })), "problem");
  assert.equal(screenOf(standing({ stage: "withdrawn", note: "kept" })), "withdrawn");
  assert.equal(screenOf(apply(standing({ note: "closed" }), { kind: "participant", participant: participant() })), "ready");
});
