import assert from "node:assert/strict";
import test from "node:test";
import { cardOf, remadeOf } from "../../../static/common/clock.js";
import { received, withFrame } from "../../../static/common/game_state.js";
import { actionOf, partOf } from "../../../static/common/keyboard.js";

const KEYS = { noop: [], right: ["ArrowRight"], jump: ["Space"], leap: ["KeyJ+Space"] };
const clock = (state, rest = {}) => ({ kind: "clock", episode: "e1", state, ms: 0, reason: null, ...rest });
const frame = (step, outcome = null) => ({ kind: "frame", episode: "e1", step, outcome, reward: 0, return: step, score: 0 });

test("the card says what to press, counts down, and goes while time runs", () => {
  assert.match(cardOf(clock("standing"), frame(0), 60, false, 0).line, /60 frames a second.*Press one of your keys to begin/);
  assert.match(cardOf(clock("standing"), frame(0), 60, true, 0).line, /Tap here/);
  assert.deepEqual(cardOf(clock("standing", { reason: "The server was late." }), frame(5), 60, false, 0).title, "Paused");
  assert.match(cardOf(clock("standing", { reason: "The server was late." }), frame(5), 60, false, 0).line, /^The server was late\./);
  const counted = [0, 900, 1100, 2100, 2999, 4000].map((passed) => cardOf(clock("countdown", { ms: 3000 }), frame(0), 60, false, passed).title);
  assert.deepEqual(counted, ["3", "3", "2", "1", "1", "1"]);
  assert.equal(cardOf(clock("running"), frame(9), 60, false, 0), null);
  assert.equal(cardOf(clock("standing"), frame(9, "ended"), 60, false, 0), null);
  assert.equal(cardOf(null, frame(9), 60, false, 0), null);
});

test("an environment that is made again says how far it is, until the next frame", () => {
  const remade = { kind: "remade", episode: "e1", done: 320, of: 1000 };
  const task = { mark: () => null, progress: () => 0 };
  const board = { frame: frame(0), trail: [null], progress: [0] };
  assert.match(remadeOf(remade).line, /move 320 of 1000/);
  const told = received(task, board, remade);
  assert.deepEqual(told.remade, remade);
  assert.equal(received(task, told, frame(1)).remade, null);
  assert.equal(received(task, board, { ...remade, episode: "e0" }).remade, undefined);
});

test("a key of a combination is one of the board's, and causes no action by itself", () => {
  assert.equal(actionOf(KEYS, "KeyJ"), undefined);
  assert.equal(partOf(KEYS, "KeyJ"), "leap");
  assert.equal(partOf(KEYS, "Space"), "jump");
  assert.equal(partOf(KEYS, "KeyQ"), undefined);
});

test("where time runs, frames that were skipped are filled up and not asked for", () => {
  const task = { clock: 60, mark: () => null, progress: (each) => each.return };
  const begun = withFrame(task, { session: "s", name: "You", frame: frame(0), trail: [], progress: [], hasGap: false }, frame(0));
  const later = withFrame(task, begun, frame(4));
  assert.deepEqual([later.hasGap, later.progress], [false, [0, 4, 4, 4, 4]]);
  assert.equal(withFrame({ ...task, clock: null }, begun, frame(4)).hasGap, true);
});

test("the state of a clock belongs to its episode alone", () => {
  const task = { clock: 60, mark: () => null, progress: () => 0 };
  const board = { session: "s", name: "You", frame: frame(0), trail: [], progress: [], hasGap: false };
  assert.equal(received(task, board, clock("running")).clock.state, "running");
  assert.equal(received(task, board, clock("running", { episode: "e0" })).clock, undefined);
});
