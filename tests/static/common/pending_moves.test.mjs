import assert from "node:assert/strict";
import test from "node:test";
import { createMoveSender } from "../../../static/common/pending_moves.js";

const frame = (step, changes = {}) => ({ episode: "e1", step, outcome: null, ...changes });
/** A sender of whose moves `steps` says which left; all of them wait. */
function sender(presses) {
  const steps = [];
  const moves = createMoveSender({ send: ({ step }) => steps.push(step) > 0, sendEvents: () => {}, now_ms: () => 0 });
  for (const [index] of Array(presses).entries()) moves.press(frame(0), "east", {}, index);
  return { moves, steps, receive: (step, changes) => moves.receive({ kind: "frame", ...frame(step, changes) }) };
}

test("presses made before an answer are due at the steps that follow", () => {
  const { moves, steps, receive } = sender(2);
  assert.deepEqual(receive(1).map((move) => move.step), [0]);
  assert.equal(moves.press(frame(1), "east", {}, 9), true);
  assert.deepEqual(steps, [0, 1, 2]);
});

test("no move is due while too many wait, and none after the end of the episode", () => {
  const { moves, steps } = sender(5);
  assert.equal(moves.isFull(), true);
  assert.deepEqual(steps, [0, 1, 2, 3]);
  assert.equal(sender(0).moves.press(frame(3, { outcome: "explored" }), "east", {}, 0), false);
});

test("a refusal, an ending and a new episode drop all moves that wait", () => {
  for (const end of [({ moves }) => moves.drop(), ({ moves }) => moves.receive({ kind: "refused" }), ({ receive }) => receive(1, { outcome: "collided" }), ({ receive }) => receive(0, { episode: "e2" })]) {
    const on = sender(2);
    end(on);
    assert.equal(on.moves.pending().length, 0);
  }
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
