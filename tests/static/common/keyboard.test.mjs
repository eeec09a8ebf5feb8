import assert from "node:assert/strict";
import test from "node:test";
import { taskOf } from "../../../static/task/mars/index.js";
import { MARS } from "../task/mars/about.mjs";
import { actionOf, codesOf, hookKeys, ownsKeys, timeOf_ms } from "../../../static/common/keyboard.js";

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

const { keys: KEYS } = taskOf(MARS);
const PAGE = { performance: { timeOrigin: 1000, now: () => 200 } };

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
  hookKeys(view, { onPress: (action, event, at) => seen.push([action, at]), onRelease: (at) => seen.push(["up", at]), onEnter: () => false, codeOf: (event) => codesOf(event)[0], actionOf: (code) => actionOf(KEYS, code) }, PAGE);
  assert.equal(view.fire("keydown", { code: "KeyD" }), true);
  assert.equal(view.fire("keydown", { code: "KeyD", repeat: true }), true);
  assert.equal(view.fire("keyup", { code: "KeyD" }), true);
  assert.deepEqual(seen, [["east", 105], ["up", 105]]);
});

test("whoever asks hears of each key that comes up, in a field too, and that a chord lets go of all", () => {
  const view = fakeWindow();
  const seen = [];
  hookKeys(view, { onPress() {}, onRelease() {}, onEnter: () => false, codeOf: (event) => codesOf(event)[0], actionOf: (code) => actionOf(KEYS, code), onLetGo: (code) => seen.push(code) }, PAGE);
  view.fire("keydown", { code: "KeyD" });
  view.fire("keyup", { code: "KeyD" });
  view.fire("keyup", { code: "KeyS", composedPath: () => [{ tagName: "INPUT", type: "text" }] });
  view.fire("keydown", { code: "MetaLeft", metaKey: true });
  view.fire("keyup", { code: "KeyD", ctrlKey: true });
  assert.deepEqual(seen, ["KeyD", "KeyS", null, null]);
});

test("chords, other keys and fields pass untouched", () => {
  const view = fakeWindow();
  hookKeys(view, { onPress: assert.fail, onRelease: assert.fail, onEnter: () => false, codeOf: (event) => codesOf(event)[0], actionOf: (code) => actionOf(KEYS, code) }, PAGE);
  assert.equal(view.fire("keydown", { code: "KeyA", ctrlKey: true }), false);
  assert.equal(view.fire("keydown", { code: "KeyQ" }), false);
  assert.equal(view.fire("keydown", { code: "Enter", key: "Enter" }), false);
  assert.equal(view.fire("keydown", { code: "KeyA", composedPath: () => [{ tagName: "INPUT", type: "text" }] }), false);
});

test("arrows and letters name the four actions", () => {
  assert.deepEqual(["ArrowUp", "KeyW", "ArrowLeft", "KeyA", "KeyQ"].map((code) => actionOf(KEYS, code)), ["north", "north", "west", "west", undefined]);
});

test("a key without a code is known by its meaning, and a code that says something wins over a letter", () => {
  const NAMELESS = [
    ["ArrowUp", ""], ["ArrowRight", "Unidentified"], ["Up", ""], ["UIKeyInputLeftArrow", ""], ["w", ""], ["7", ""], [" ", ""], ["Escape", ""],
  ];
  const codes = NAMELESS.map(([key, code]) => codesOf({ key, code }).join());
  assert.deepEqual(codes, ["ArrowUp", "ArrowRight", "ArrowUp", "ArrowLeft", "KeyW", "Digit7", "Space", "Escape"]);
  assert.deepEqual(codesOf({ key: "Unidentified", code: "", keyCode: 40 }), ["ArrowDown"]);
  assert.deepEqual(codesOf({ key: "Unidentified", code: "", keyCode: 229 }), []);
  assert.deepEqual(codesOf({ key: "a", code: "KeyQ" }), ["KeyQ"]); // by its place, whatever is printed on it
  assert.deepEqual(codesOf({ key: "ArrowRight", code: "Numpad6" }), ["Numpad6", "ArrowRight", "ArrowRight"]);
  assert.deepEqual(codesOf({ key: "8", code: "Numpad8" }), ["Numpad8", "ArrowUp"]);
  assert.deepEqual(codesOf({ key: "ArrowDown", code: "KeyJ" }), ["KeyJ", "ArrowDown"]); // a layer of a small keyboard
});

test("an event has one time, never later than now, and now where its own cannot be believed", () => {
  let now = 20_000;
  const page = { performance: { timeOrigin: 0, now: () => now } };
  const event = { timeStamp: 19_990.04 };
  assert.equal(timeOf_ms(event, page, page), 19_990.04);
  for (const timeStamp of [20_001, 9_000, 1.7e12]) assert.equal(timeOf_ms({ timeStamp }, page, page), 20_000);
  const late = { timeStamp: 30_000 };
  timeOf_ms(late, page, page);
  now = 21_000;
  assert.equal(timeOf_ms(late, page, page), 20_000, "the input event and its move have the same time");
});
