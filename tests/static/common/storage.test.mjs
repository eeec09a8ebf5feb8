import assert from "node:assert/strict";
import test from "node:test";
import { createStore } from "../../../static/common/storage.js";

const blocked = () => { throw new Error("SecurityError"); };
const full = { getItem: () => null, setItem: blocked, removeItem: blocked };

test("storage in any bad state throws nothing, and what is set holds until the page is left", () => {
  for (const open of [blocked, () => null, () => undefined, () => full, () => ({ getItem: blocked, setItem: blocked, removeItem: blocked })]) {
    const store = createStore(open);
    assert.equal(store.isKept(), false);
    assert.equal(store.getItem("a"), null);
    store.setItem("a", "[1]");
    assert.deepEqual([store.getItem("a"), store.read("a")], ["[1]", [1]]);
    store.removeItem("a");
    assert.equal(store.getItem("a"), null);
  }
});

test("what is no JSON reads as nothing", () => {
  const map = new Map([["a", "{"]]);
  const store = createStore(() => ({ getItem: (key) => map.get(key) ?? null, setItem: (key, text) => map.set(key, text), removeItem: (key) => map.delete(key) }));
  assert.deepEqual([store.read("a"), store.read("b"), store.isKept()], [null, null, true]);
  store.setItem("a", "2");
  assert.deepEqual([map.get("a"), map.size], ["2", 1]);
});
