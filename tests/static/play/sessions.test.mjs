import assert from "node:assert/strict";
import test from "node:test";
import { episodeInHash, sessionInHash, sessionWish } from "../../../static/play/sessions.js";

test("each mode asks for its own kind of session", () => {
  const wish = { level: "random", size: 21, seed: null, rival: "ppo", player: "random" };
  assert.deepEqual(sessionWish("practice", wish), { level: "random", size: 21, player: "human", rival: "ppo" });
  assert.deepEqual(sessionWish("ranked", wish), { level: "random", size: 21, player: "human" });
  assert.deepEqual(sessionWish("watch", { ...wish, seed: 0 }), { level: "random", size: 21, seed: 0, player: "random", rival: "ppo" });
});

test("the address names an episode that anybody may watch", () => {
  assert.equal(episodeInHash("#watch=00ff00ff00ff00ff"), "00ff00ff00ff00ff");
  assert.equal(episodeInHash("#watch=<script>"), null);
  assert.equal(episodeInHash("#s=ab_c-1234"), null);
});

test("an address of an earlier version names a session", () => {
  assert.equal(sessionInHash("#s=ab_c-1234"), "ab_c-1234");
  assert.equal(sessionInHash("#s=<script>"), null);
  assert.equal(sessionInHash(""), null);
});
