import assert from "node:assert/strict";
import test from "node:test";
import { givesBack } from "../../../static/play/focus.js";

/** An element inside others. */
const inside = (...names) => ({ closest: (selector) => selector.split(", ").some((each) => names.includes(each)) || null });

test("a click by a pointer on a control gives the keys back to the board; one by Enter or Space, and one in a dialog, do not", () => {
  assert.equal(givesBack({ detail: 1 }, inside("button")), true);
  assert.equal(givesBack({ detail: 1 }, inside("label")), true);
  assert.equal(givesBack({ detail: 0 }, inside("button")), false);
  assert.equal(givesBack({ detail: 1 }, inside("button", "dialog")), false);
  assert.equal(givesBack({ detail: 1 }, inside("p")), false);
  assert.equal(givesBack({ detail: 1 }, null), false);
});
