import assert from "node:assert/strict";
import { mock, test } from "node:test";
import { readDetail, request, ROOT } from "../../../static/common/api.js";

test("whatever FastAPI says becomes one sentence", () => {
  assert.equal(readDetail("rows must be at least 5, got 3", 422), "rows must be at least 5, got 3");
  assert.equal(readDetail([{ loc: ["body", "size"], msg: "is wrong" }], 422), "size is wrong");
  assert.equal(readDetail(undefined, 502), "The server answered 502.");
  assert.equal(readDetail("KeyError: 3", 500), "The fault is the server's, and it has noted it. Try again in a moment.");
});

test("what is read is asked for again when the server says when, while there is time", async () => {
  mock.timers.enable({ apis: ["setTimeout", "Date"] });
  const answers = [[503, 5], [503, 5], [200, 0]];
  /** @type {string[]} */
  const asked = [];
  // @ts-expect-error no more of an answer than is looked at
  globalThis.fetch = async (path) => {
    const [status, wait_s] = answers[asked.push(path) - 1] ?? [503, 600];
    return { ok: status === 200, status, headers: new Headers({ "retry-after": String(wait_s) }), json: async () => ({ detail: "busy" }) };
  };
  const settled = async () => { for (let turn = 0; turn < 20; turn += 1) await null; };
  const found = request("a", undefined, 60_000);
  for (const count of [1, 2, 3]) {
    await settled();
    assert.deepEqual(asked, Array(count).fill(`${ROOT}api/a`));
    mock.timers.tick(5000);
  }
  assert.deepEqual(await found, { detail: "busy" });
  await assert.rejects(request("a", undefined, 60_000), /busy/, "ten minutes are too long");
  answers[asked.length] = [503, 5];
  await assert.rejects(request("a", {}, 60_000), /busy/, "nothing is done twice");
  mock.timers.reset();
});
