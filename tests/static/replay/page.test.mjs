// A replay's page: a place on the scrubber, and the addresses that it can be shared by.
import assert from "node:assert/strict";
import test from "node:test";
import { stepAt } from "../../../static/replay/curve.js";
import { fileAddress, ghostInSearch, linkTo, moveInHash } from "../../../static/replay/sharing.js";

test("a place on the scrubber is a move", () => {
  assert.deepEqual([0, 44, 243, 442, 999].map((x) => stepAt(x, 456, 80)), [0, 0, 40, 80, 80]);
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
