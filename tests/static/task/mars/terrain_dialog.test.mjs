import assert from "node:assert/strict";
import test from "node:test";
import { favourite } from "../../../../static/task/mars/words.js";
import { MAX_SEED, readWish } from "../../../../static/task/mars/terrain_dialog.js";

test("a filled form is a wish, a wrong one a sentence", () => {
  const fields = { level: "1-1-1", side: "42", rows: "9", cols: "11", seed: " ", rival: "ppo", player: "random" };
  assert.deepEqual(readWish(fields), { level: "1-1-1", map: null, size: 42, seed: null, rival: "ppo", player: "random" });
  assert.deepEqual(readWish({ ...fields, side: "custom", seed: "7" }).size, [9, 11]);
  assert.equal(readWish({ ...fields, seed: String(MAX_SEED) }).seed, MAX_SEED);
  for (const wrong of [{ side: "custom", rows: "4" }, { side: "custom", cols: "129" }, { side: "custom", rows: "5.5" }, { seed: "-1" },
    { seed: "9007199254740993" }, { seed: "0x1" }]) assert.equal(typeof readWish({ ...fields, ...wrong }), "string");
});

test("a map is wished for by its name, whatever stands in the fields of level, size and seed", () => {
  const fields = { level: "map:my office", side: "custom", rows: "1", cols: "", seed: "x", rival: "ppo", player: "random" };
  const { level, map, seed } = /** @type {any} */ (readWish(fields));
  assert.deepEqual([level, map, seed], ["map", "my office", null]);
});

test("the default rival is the trained one, else the best rule", () => {
  assert.equal(favourite(["random", "ppo-21", "frontier-utility"]), "ppo-21");
  assert.equal(favourite(["random", "frontier-utility", "frontier-cost"]), "frontier-utility");
  assert.equal(favourite([]), "");
});
