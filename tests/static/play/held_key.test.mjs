import assert from "node:assert/strict";
import test from "node:test";
import { createHeldKey, DEFAULT_PACE, DELAY_MS, paceOf } from "../../../static/play/input.js";

/** A held key in front of a clock that a test moves. */
function clockwork({ pace = 8, may = () => true, repeat = () => true } = {}) {
  let now = 0;
  let timers = [];
  const moves = [];
  const key = createHeldKey({
    pace: () => pace, mayRepeat: () => may(), now_ms: () => now,
    repeat: (action) => { moves.push([action, now]); return repeat(); },
    after(wait_ms, work) {
      const timer = { at: now + wait_ms, work };
      timers.push(timer);
      return () => { timers = timers.filter((each) => each !== timer); };
    },
  });
  /** @param {number} to @param {number} late how late the page gets to its timers */
  function run(to, late = 0) {
    for (;;) {
      const next = timers.filter(({ at }) => at + late <= to).sort((a, b) => a.at - b.at)[0];
      if (!next) break;
      timers = timers.filter((each) => each !== next);
      now = Math.max(now, next.at + late);
      next.work();
    }
    now = to;
  }
  return { key, moves, run, count: () => timers.length };
}

test("a held key repeats at the set pace after a delay, until it comes up", () => {
  const { key, moves, run, count } = clockwork();
  key.down("KeyD", "east");
  run(DELAY_MS - 1);
  assert.deepEqual(moves, [], "the press itself has made its move");
  run(DELAY_MS + 500);
  assert.deepEqual(moves.map(([, at]) => at), [250, 375, 500, 625, 750]);
  key.up("KeyW");
  assert.equal(count(), 1, "another key came up");
  key.up("KeyD");
  run(5000);
  assert.equal(moves.length, 5);
  assert.equal(count(), 0);
});

test("the newest key takes over, and nothing goes on when it comes up", () => {
  const { key, moves, run } = clockwork();
  key.down("KeyD", "east");
  run(400);
  key.down("KeyS", "south");
  key.up("KeyD");
  run(400 + DELAY_MS);
  assert.deepEqual(moves.at(-1), ["south", 650]);
  key.up("KeyS");
  assert.equal(key.holder(), null);
});

test("a lost focus, a dialog, an end and a rock let go of the key for good", () => {
  let may = true;
  let goesOn = true;
  const { key, moves, run } = clockwork({ may: () => may, repeat: () => goesOn });
  key.down("KeyD", "east");
  run(260);
  key.stop();
  run(1000);
  assert.equal(moves.length, 1);
  key.down("KeyD", "east");
  may = false;
  run(2000);
  may = true;
  run(3000);
  assert.equal(moves.length, 1);
  key.down("KeyD", "east");
  goesOn = false;
  run(9000);
  assert.equal(moves.length, 2, "it was refused once, and is not asked again");
});

test("a page that was busy catches up on nothing", () => {
  const { key, moves, run } = clockwork();
  key.down("KeyD", "east");
  run(1300, 1000);
  assert.deepEqual(moves.map(([, at]) => at), [1250], "a thousand milliseconds late");
  run(1500);
  assert.deepEqual(moves.map(([, at]) => at), [1250, 1312.5, 1437.5]);
});

test("nothing repeats where it is turned off, or in ranked play", () => {
  for (const how of [{ pace: 0 }, { may: () => false }]) {
    const { key, moves, run, count } = clockwork(how);
    key.down("KeyD", "east");
    assert.equal(count(), 0);
    run(3000);
    assert.deepEqual(moves, []);
  }
});

test("the setting is one of the paces, else the default", () => {
  assert.equal(paceOf(null), DEFAULT_PACE);
  assert.equal(paceOf("0"), 0);
  assert.equal(paceOf("12"), 12);
  for (const stored of ["-1", "900", "fast"]) assert.equal(paceOf(stored), DEFAULT_PACE);
});
