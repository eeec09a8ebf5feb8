import assert from "node:assert/strict";
import test from "node:test";
import { act, parse } from "../../../static/common/messages.js";

test("an act carries episode, step, action and times", () => {
  assert.deepEqual(act("e1", 4, "west", { input: null, key_down_ms: 1, key_up_ms: null, client_ms: 2 }),
    { kind: "act", episode: "e1", step: 4, action: "west", input: null, key_down_ms: 1, key_up_ms: null, client_ms: 2 });
});

test("what is none of ours parses to null", () => {
  for (const text of ["", "{", "3", "null", '{"kind":"launch"}']) assert.equal(parse(text), null);
  assert.equal(parse('{"kind":"error","detail":"x"}').detail, "x");
  assert.equal(parse('{"kind":"remade","episode":"e1","done":1,"of":3}').of, 3);
});
