import assert from "node:assert/strict";
import test from "node:test";
import { sessionInHash, sessionWish } from "../../../static/play/sessions.js";

test("each mode asks for its own kind of session", () => {
  const wish = { level: "random", size: 21, seed: null, rival: "ppo", player: "random" };
  assert.deepEqual(sessionWish("practice", wish), { level: "random", size: 21, player: "human", rival: "ppo" });
  assert.deepEqual(sessionWish("ranked", wish), { level: "random", size: 21, player: "human" });
  assert.deepEqual(sessionWish("watch", { ...wish, seed: 0 }), { level: "random", size: 21, seed: 0, player: "random", rival: "ppo" });
});

test("a session stands in the address", () => {
  assert.equal(sessionInHash("#s=ab_c-1234"), "ab_c-1234");
  assert.equal(sessionInHash("#s=<script>"), null);
  assert.equal(sessionInHash(""), null);
});
