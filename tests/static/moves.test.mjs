import assert from "node:assert/strict";
import test from "node:test";
import { timing } from "../../static/common/controls.js";
import { hookKeys, KEYS, ownsKeys } from "../../static/common/keyboard.js";
import { answeredBy, createMoveSender, nextStep, noMoves, withMove, withoutMoves } from "../../static/common/pending_moves.js";
import { act, parse } from "../../static/common/messages.js";

const frame = (step, changes = {}) => ({ episode: "e1", step, outcome: null, ...changes });
const push = (moves, step) => withMove(moves, { episode: "e1", step, pressed_ms: 0, sent_ms: 0 });

test("presses made before an answer are due at the steps that follow", () => {
  const moves = push(push(noMoves(4), 5), 6);
  assert.equal(nextStep(moves, frame(5)), 7);
  const { moves: rest, answered } = answeredBy(moves, frame(6));
  assert.deepEqual(answered.map((move) => move.step), [5]);
  assert.equal(nextStep(rest, frame(6)), 7);
});

test("a full moves takes no more, an ended episode takes none", () => {
  assert.equal(nextStep(push(push(noMoves(2), 0), 1), frame(0)), null);
  assert.equal(nextStep(noMoves(), frame(3, { outcome: "explored" })), null);
});

test("a refusal, an ending and a new episode empty the moves", () => {
  const moves = push(push(noMoves(), 0), 1);
  assert.equal(withoutMoves(moves).pending.length, 0);
  assert.equal(answeredBy(moves, frame(1, { outcome: "collided" })).moves.pending.length, 0);
  assert.equal(answeredBy(moves, frame(0, { episode: "e2" })).moves.pending.length, 0);
});

test("a sender sends the step that is due, measures the round trip, and returns what was answered", () => {
  let now = 10;
  const sent = [];
  const moves = createMoveSender({ send: (message) => sent.push(message) > 0, now_ms: () => now });
  const on = { kind: "frame", ...frame(0) };
  const press = (pressed_ms) => moves.press(on, "east", { input: "key", key_down_ms: 1, key_up_ms: null, client_ms: 2 }, pressed_ms);
  press(8);
  press(9);
  assert.deepEqual(sent.map(({ step }) => step), [0, 1]);
  now = 21.26;
  assert.deepEqual(moves.receive({ ...on, step: 1 }).map(({ pressed_ms }) => pressed_ms), [8]);
  assert.equal(moves.round_trip_ms(), 11.3);
  assert.deepEqual(moves.receive({ kind: "refused", reason: "stale", frame: on }), []);
  assert.deepEqual(moves.receive({ ...on, step: 2 }), [], "a refusal has dropped the other one");
});

test("only a trusted event in a browser that nobody drives is a key or a touch", () => {
  assert.equal(timing("key", { isTrusted: true }, false, 1, null, 2).input, "key");
  assert.equal(timing("touch", { isTrusted: true }, false, 1, null, 2).input, "touch");
  assert.equal(timing("key", { isTrusted: false }, false, 1, null, 2).input, null);
  assert.equal(timing("key", { isTrusted: true }, true, 1, null, 2).input, null);
  assert.deepEqual(timing("key", { isTrusted: true }, false, 10.123, 8, 11), { input: "key", key_down_ms: 10.1, key_up_ms: 8, client_ms: 11 });
});

test("an act carries episode, step, action and times", () => {
  assert.deepEqual(act("e1", 4, "west", { input: null, key_down_ms: 1, key_up_ms: null, client_ms: 2 }),
    { kind: "act", episode: "e1", step: 4, action: "west", input: null, key_down_ms: 1, key_up_ms: null, client_ms: 2 });
});

test("what is none of ours parses to null", () => {
  for (const text of ["", "{", "3", "null", '{"kind":"launch"}']) assert.equal(parse(text), null);
  assert.equal(parse('{"kind":"error","detail":"x"}').detail, "x");
});

test("fields, sliders, tabs and dialogs keep their keys; buttons do not", () => {
  const of = (tagName, type, inside = false) => ({ tagName, type, closest: () => (inside ? {} : null) });
  assert.equal(ownsKeys(of("INPUT", "text")), true);
  assert.equal(ownsKeys(of("INPUT", "range")), true);
  assert.equal(ownsKeys(of("INPUT", "checkbox")), false);
  assert.equal(ownsKeys(of("SELECT")), true);
  assert.equal(ownsKeys(of("BUTTON")), false);
  assert.equal(ownsKeys(of("DIV", undefined, true)), true);
  assert.equal(ownsKeys({ isContentEditable: true }), true);
  assert.equal(ownsKeys(null), false);
});

/** A window that only listens, 100 ms younger than the page. */
function fakeWindow() {
  const listeners = { keydown: [], keyup: [] };
  return {
    performance: { timeOrigin: 1100 },
    addEventListener: (kind, listener, capture) => capture === true && listeners[kind].push(listener),
    fire(kind, event) {
      const full = { type: kind, key: "", timeStamp: 5, composedPath: () => [{ tagName: "CANVAS" }], swallowed: 0,
        preventDefault() { this.swallowed += 1; }, stopImmediatePropagation() { this.swallowed += 1; }, ...event };
      for (const listener of listeners[kind]) listener(full);
      return full.swallowed === 2;
    },
  };
}

test("drive keys are swallowed in the capture phase, once a press, in the page's own time", () => {
  const view = fakeWindow();
  const seen = [];
  hookKeys(view, { onPress: (action, event, at) => seen.push([action, at]), onRelease: (at) => seen.push(["up", at]), onEnter: () => false }, 1000);
  assert.equal(view.fire("keydown", { code: "KeyD" }), true);
  assert.equal(view.fire("keydown", { code: "KeyD", repeat: true }), true);
  assert.equal(view.fire("keyup", { code: "KeyD" }), true);
  assert.deepEqual(seen, [["east", 105], ["up", 105]]);
});

test("chords, other keys and fields pass untouched", () => {
  const view = fakeWindow();
  hookKeys(view, { onPress: assert.fail, onRelease: assert.fail, onEnter: () => false }, 1000);
  assert.equal(view.fire("keydown", { code: "KeyA", ctrlKey: true }), false);
  assert.equal(view.fire("keydown", { code: "KeyQ" }), false);
  assert.equal(view.fire("keydown", { code: "Enter", key: "Enter" }), false);
  assert.equal(view.fire("keydown", { code: "KeyA", composedPath: () => [{ tagName: "INPUT", type: "text" }] }), false);
});

test("arrows and letters name the four actions", () => {
  assert.deepEqual([...new Set(Object.values(KEYS))].sort(), ["east", "north", "south", "west"]);
  assert.equal(KEYS.ArrowUp, KEYS.KeyW);
  assert.equal(KEYS.ArrowLeft, KEYS.KeyA);
});
