import assert from "node:assert/strict";
import test from "node:test";
import { createSound, soundOf, SOUND_SETTING, tonesOf } from "../../../static/play/input.js";
import { taskOf } from "../../../static/task/mars/index.js";
import { MARS } from "../task/mars/about.mjs";

const task = taskOf(MARS);
const frame = (step, discovered, changes = {}) => ({ episode: "e1", step, discovered, outcome: null, ...changes });

test("moves are heard as the task has it; a new terrain and an old frame are not", () => {
  assert.deepEqual(soundOf(task, frame(0, 9), frame(1, 13)), { kind: "gain", count: 4 });
  assert.equal(soundOf(task, frame(0, 9), frame(1, 9)), null);
  assert.equal(soundOf(task, frame(4, 9), frame(0, 30, { episode: "e2" })), null);
  assert.equal(soundOf(task, frame(4, 9), frame(4, 9)), null);
  assert.equal(soundOf(task, null, frame(0, 9)), null);
});

test("the more cells, the higher the tone, and everything is short and soft", () => {
  const pitches = Array.from({ length: 20 }, (_, index) => tonesOf({ kind: "gain", count: index + 1 })[0].hertz);
  assert.deepEqual(pitches, [...pitches].sort((a, b) => a - b));
  assert.ok(pitches[12] > pitches[0] * 4);
  for (const kind of ["gain", "blocked", "crash", "finish", "over"]) {
    for (const tone of tonesOf({ kind, count: 3 })) assert.ok(tone.at_s + tone.for_s < 1 && tone.loud <= 0.15 && tone.hertz > 60, kind);
  }
});

test("sound is off until its button is pressed, and the choice is kept", () => {
  const kept = new Map();
  const storage = { getItem: (name) => kept.get(name) ?? null, setItem: (name, value) => kept.set(name, value), removeItem: (name) => kept.delete(name) };
  const button = { attributes: {}, setAttribute(name, value) { this.attributes[name] = value; }, addEventListener(_, work) { this.press = work; } };
  let made = 0;
  class Node { connect(other) { return other; } start() {} stop() {} gain = { setValueAtTime() {}, linearRampToValueAtTime() {}, exponentialRampToValueAtTime() {} }; }
  globalThis.GainNode = globalThis.OscillatorNode = Node;
  const sound = createSound(button, { storage, makeContext: () => { made += 1; return { state: "running", currentTime: 0, destination: {} }; } });
  sound.play({ kind: "crash" });
  assert.equal(made, 0, "not even the means of sound are there");
  assert.equal(button.attributes["aria-pressed"], "false");
  button.press();
  assert.equal(kept.get(SOUND_SETTING), "on");
  sound.play({ kind: "crash" });
  assert.equal(made, 1);
  assert.equal(createSound({ ...button, attributes: {} }, { storage, makeContext: () => assert.fail() }) && kept.size, 1);
  button.press();
  assert.equal(kept.size, 0);
});
