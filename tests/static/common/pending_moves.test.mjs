import assert from "node:assert/strict";
import test from "node:test";
import { answeredBy, createMoveSender, nextStep, noMoves, withMove, withoutMoves } from "../../../static/common/pending_moves.js";

const frame = (step, changes = {}) => ({ episode: "e1", step, outcome: null, ...changes });
const push = (moves, step) => withMove(moves, { episode: "e1", step, pressed_ms: 0, sent_ms: 0 });

test("presses made before an answer are due at the steps that follow", () => {
  const moves = push(push(noMoves(4), 5), 6);
  assert.equal(nextStep(moves, frame(5)), 7);
  const { moves: rest, answered } = answeredBy(moves, frame(6));
  assert.deepEqual(answered.map((move) => move.step), [5]);
  assert.equal(nextStep(rest, frame(6)), 7);
});

test("no move is due while too many wait, and none after the end of the episode", () => {
  assert.equal(nextStep(push(push(noMoves(2), 0), 1), frame(0)), null);
  assert.equal(nextStep(noMoves(), frame(3, { outcome: "explored" })), null);
});

test("a refusal, an ending and a new episode drop all moves that wait", () => {
  const moves = push(push(noMoves(), 0), 1);
  assert.equal(withoutMoves(moves).pending.length, 0);
  assert.equal(answeredBy(moves, frame(1, { outcome: "collided" })).moves.pending.length, 0);
  assert.equal(answeredBy(moves, frame(0, { episode: "e2" })).moves.pending.length, 0);
});

test("a sender sends the step that is due, measures the round trip, and returns what was answered", () => {
  let now = 10;
  const sent = [];
  const moves = createMoveSender({ send: (message) => sent.push(message) > 0, sendEvents: () => sent.push({ step: "events" }), now_ms: () => now });
  const on = { kind: "frame", ...frame(0) };
  const press = (pressed_ms) => moves.press(on, "east", { input: "key", key_down_ms: 1, key_up_ms: null, client_ms: 2 }, pressed_ms);
  press(8);
  press(9);
  assert.deepEqual(sent.map(({ step }) => step), ["events", 0, "events", 1], "what caused a move goes before it");
  now = 21.26;
  assert.deepEqual(moves.receive({ ...on, step: 1 }).map(({ pressed_ms }) => pressed_ms), [8]);
  assert.equal(moves.round_trip_ms(), 11.3);
  assert.deepEqual(moves.receive({ kind: "refused", reason: "stale", frame: on }), []);
  assert.deepEqual(moves.receive({ ...on, step: 2 }), [], "a refusal has dropped the other one");
});
