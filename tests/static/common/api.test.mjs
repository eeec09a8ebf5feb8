import assert from "node:assert/strict";
import test from "node:test";
import { readDetail } from "../../../static/common/api.js";

test("whatever FastAPI says becomes one sentence", () => {
  assert.equal(readDetail("rows must be at least 5, got 3", 422), "rows must be at least 5, got 3");
  assert.equal(readDetail([{ loc: ["body", "size"], msg: "is wrong" }], 422), "size is wrong");
  assert.equal(readDetail(undefined, 502), "The server answered 502.");
});
