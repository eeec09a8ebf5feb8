import assert from "node:assert/strict";
import test from "node:test";
import { createSwipe, directionOf, SWIPE_PX } from "../../../static/play/input.js";

const pointer = (type, x, y, other = {}) => ({ type, clientX: x, clientY: y, pointerId: 1, pointerType: "touch", isPrimary: true, ...other });

/** A surface that keeps what was swiped. */
function surface(isOn = () => true) {
  const seen = [];
  const take = createSwipe({ isOn, actionOf: (code) => ({ ArrowRight: "east", ArrowLeft: "west", ArrowDown: "south", ArrowUp: "north" })[code], onSwipe: (action) => seen.push(action), onEnd: (action) => seen.push(`${action} ends`) });
  return { seen, take };
}

test("a swipe goes where the finger went furthest, once that is clear", () => {
  assert.equal(directionOf(SWIPE_PX, 3), "ArrowRight");
  assert.equal(directionOf(-40, 20), "ArrowLeft");
  assert.equal(directionOf(0, 30), "ArrowDown");
  assert.equal(directionOf(5, -30), "ArrowUp");
  assert.equal(directionOf(SWIPE_PX - 1, 0), null);
  assert.equal(directionOf(40, 38), null);
});

test("one swipe is one move, however long, until the finger comes up", () => {
  const { seen, take } = surface();
  assert.equal(take(pointer("pointerdown", 100, 100)), true);
  for (const x of [110, 130, 190, 300]) assert.equal(take(pointer("pointermove", x, 101)), true);
  take(pointer("pointermove", 300, 300));
  assert.deepEqual(seen, ["east"]);
  take(pointer("pointerup", 300, 300));
  assert.deepEqual(seen, ["east", "east ends"]);
  take(pointer("pointerdown", 0, 0));
  take(pointer("pointerup", 4, 4));
  assert.deepEqual(seen.length, 2, "a tap is no swipe");
});

test("a mouse and a board that nobody drives are left to others; a second finger does nothing", () => {
  let isOn = true;
  const { seen, take } = surface(() => isOn);
  assert.equal(take(pointer("pointerdown", 0, 0, { pointerType: "mouse" })), false);
  take(pointer("pointerdown", 0, 0));
  assert.equal(take(pointer("pointerdown", 90, 90, { pointerId: 2, isPrimary: false })), true);
  assert.equal(take(pointer("pointermove", 9, 190, { pointerId: 2, isPrimary: false })), true);
  take(pointer("pointermove", 0, 190));
  take(pointer("pointerup", 0, 190));
  assert.deepEqual(seen, [], "two fingers swipe nothing");
  take(pointer("pointerup", 9, 190, { pointerId: 2, isPrimary: false }));
  take(pointer("pointerdown", 0, 0));
  isOn = false;
  take(pointer("pointermove", 90, 0));
  take(pointer("pointercancel", 90, 0));
  assert.deepEqual(seen, ["east", "east ends"], "a finger that was down before goes on to its end");
  assert.equal(take(pointer("pointerdown", 0, 0)), false);
  assert.equal(take(pointer("pointermove", 90, 0)), false);
});
