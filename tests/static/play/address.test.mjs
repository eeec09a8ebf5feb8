import assert from "node:assert/strict";
import test from "node:test";
import { askedIn, queryOf } from "../../../static/play/address.js";

const wish = (changes = {}) => ({ level: "random", map: null, size: 21, seed: null, rival: "ppo", player: "ppo", ...changes });

test("an address says which way of playing it is, and a terrain that somebody chose", () => {
  assert.equal(queryOf("practice", wish()), "");
  assert.equal(queryOf("watch", wish()), "?mode=watch");
  assert.equal(queryOf("practice", wish({ level: "cave", size: [15, 20], seed: 7 })), "?level=cave&size=15x20&seed=7");
  assert.equal(queryOf("practice", wish({ map: "office" })), "?map=office");
  assert.equal(queryOf("challenge", null), "");
});

test("a ranked address holds no seed, and none is read from one", () => {
  assert.equal(queryOf("ranked", wish({ size: 42, seed: 7 })), "?mode=ranked&level=random&size=42");
  assert.equal(askedIn("?mode=ranked&level=cave&size=21&seed=7")?.wish.seed, null);
});

test("what an address asks for is what it was made of", () => {
  for (const asked of [wish({ level: "cave", size: [15, 20], seed: 7 }), wish({ level: "3-2-1", size: 42 })]) {
    const { level, map, size, seed } = asked;
    assert.deepEqual(askedIn(queryOf("watch", asked)), { mode: "watch", wish: { level, map, size, seed } });
  }
  assert.deepEqual(askedIn("?mode=watch"), { mode: "watch", wish: {} });
  assert.deepEqual(askedIn("?map=office"), { mode: "practice", wish: { level: "map", map: "office" } });
  for (const nothing of ["", "?utm=1", "?mode=study", "?seed=7"]) assert.equal(askedIn(nothing), null);
});
