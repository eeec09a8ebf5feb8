// How a replay goes on: clock, keys, speed, the pointer over the scrubber, and the addresses that it can be shared by.
import assert from "node:assert/strict";
import test from "node:test";
import { plotBox, stepAt } from "../../../static/replay/curve.js";
import { begun, keyed, later, movedTo, SPEEDS, stepOf, toggled, withLast } from "../../../static/replay/playback.js";
import { fileAddress, ghostInSearch, linkTo, moveInHash } from "../../../static/replay/sharing.js";

test("time passes at the speed that is set and stops at the end", () => {
  const playing = toggled({ ...begun(20), speed: 8 });
  assert.equal(stepOf(later(playing, 0.5)), 4);
  assert.equal(stepOf(later(later(playing, 0.06), 0.07)), 1, "parts of a move add up");
  const ended = later(playing, 60);
  assert.deepEqual([stepOf(ended), ended.isPlaying], [20, false]);
  assert.equal(stepOf(toggled(ended)), 0, "playing again begins again");
  assert.equal(later(begun(20), 9).at, 0);
});

test("a long replay begins faster", () => {
  assert.deepEqual([40, 90, 200, 100_000].map((last) => begun(last).speed), [8, 8, 16, 64]);
});

test("keys", () => {
  let playback = movedTo(begun(30), 5);
  for (const [key, step] of [["ArrowRight", 6], ["ArrowLeft", 5], ["End", 30], ["ArrowRight", 30], ["Home", 0], ["ArrowLeft", 0], ["PageUp", 10]]) {
    playback = keyed(playback, key);
    assert.equal(stepOf(playback), step, key);
  }
  assert.equal(stepOf(keyed(playback, "ArrowRight", true)), 20);
  assert.equal(keyed(playback, " ").isPlaying, true);
  assert.equal(keyed(keyed(playback, " "), "ArrowRight").isPlaying, false);
  assert.equal(keyed(playback, "+").speed, 16);
  assert.equal(keyed(playback, "-").speed, 4);
  assert.equal(keyed({ ...playback, speed: SPEEDS.at(-1) }, "+").speed, SPEEDS.at(-1));
  assert.equal(keyed(playback, "x"), null);
});

test("hovering shows another move while nothing plays, and leaves the replay where it is", () => {
  const paused = { ...movedTo(begun(30), 5), hovered: 17 };
  assert.equal(stepOf(paused), 17);
  assert.equal(stepOf({ ...paused, hovered: null }), 5);
  assert.equal(stepOf(toggled(paused)), 5);
  assert.equal(stepOf(withLast(movedTo(begun(30), 25), 20)), 20);
});

test("a place on the scrubber is a move", () => {
  const box = plotBox(456, 120);
  assert.deepEqual([0, box.left, (box.left + box.right) / 2, box.right, 999].map((x) => stepAt(x, box, 80)), [0, 0, 40, 80, 80]);
});

test("a link holds the policy where it is not the usual one, and the move where it is neither the first nor the last", () => {
  const page = "http://mars.example/replay/0123?ghost=random#move=3";
  const shown = { ghost: "ppo", preferred: "ppo", step: 0, last: 75 };
  assert.equal(linkTo(page, shown), "http://mars.example/replay/0123");
  assert.equal(linkTo(page, { ...shown, step: 75 }), "http://mars.example/replay/0123");
  assert.equal(linkTo(page, { ...shown, ghost: "a b", step: 40 }), "http://mars.example/replay/0123?ghost=a+b#move=40");
  assert.equal(linkTo(page, { ...shown, ghost: null }), "http://mars.example/replay/0123?ghost=none");
  assert.deepEqual(["", "?ghost=none", "?ghost=a+b"].map(ghostInSearch), [undefined, null, "a b"]);
  assert.deepEqual(["#move=40", "#move=x", ""].map(moveInHash), [40, null, null]);
  assert.equal(fileAddress("0123", "gif", null), "0123.gif?ghost=none");
  assert.equal(fileAddress("0123", "png", "ppo"), "0123.png");
});
