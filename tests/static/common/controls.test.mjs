import assert from "node:assert/strict";
import test from "node:test";
import { timing } from "../../../static/common/keyboard.js";

test("only a trusted event in a browser that nobody drives is a key or a touch", () => {
  assert.equal(timing("key", { isTrusted: true }, false, 1, null, 2).input, "key");
  assert.equal(timing("touch", { isTrusted: true }, false, 1, null, 2).input, "touch");
  assert.equal(timing("key", { isTrusted: false }, false, 1, null, 2).input, null);
  assert.equal(timing("key", { isTrusted: true }, true, 1, null, 2).input, null);
  assert.deepEqual(timing("key", { isTrusted: true }, false, 10.123, 8, 11), { input: "key", key_down_ms: 10.1, key_up_ms: 8, client_ms: 11 });
});
