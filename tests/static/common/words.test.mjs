import assert from "node:assert/strict";
import test from "node:test";
import * as words from "../../../static/common/words.js";

test("coverage never reads 99.0 before 99 % are known", () => {
  assert.equal(words.percent(0.98999), "98.9");
  assert.equal(words.percent(0.99), "99.0");
  assert.equal(words.percent(1), "100.0");
});
