// How the replay of a finished episode goes on by clock, keys, speed and pointer.
import assert from "node:assert/strict";
import test from "node:test";
import { begun, keyed, later, movedTo, SPEEDS, stepOf, toggled, withLast } from "../../../static/common/player.js";

test("time passes at the speed that is set and stops at the end", () => {
  const playing = toggled({ ...begun(20), speed: 8 });
  assert.equal(stepOf(later(playing, 0.5)), 4);
  assert.equal(stepOf(later(later(playing, 0.06), 0.07)), 1, "parts of a move add up");
  const ended = later(playing, 60);
  assert.deepEqual([stepOf(ended), ended.isPlaying], [20, false]);
  assert.equal(stepOf(toggled(ended)), 0, "playing again begins again");
  assert.equal(later(begun(20), 9).at, 0);
});

test("a long replay begins faster, unless a speed is asked for", () => {
  assert.equal(begun(90, 6.25).speed, 6.25);
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
