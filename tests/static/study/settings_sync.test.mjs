import assert from "node:assert/strict";
import test from "node:test";
import { createSettingsSync } from "../../../static/study/settings.js";

/** A settings sync of `chosen.now`; `requests` are those that were begun, each ended by the test or by its signal. */
function saving(how = {}) {
  const chosen = { now: "standard" };
  const requests = [];
  const settingsSync = createSettingsSync({ settle_ms: 1, retry_ms: 1, ...how, save: (signal) => new Promise((resolve, reject) => {
    const request = { value: chosen.now, signal, isOpen: true };
    const ending = (settle) => (value) => { request.isOpen = false; settle(value); };
    Object.assign(request, { answer: ending(resolve), fail: ending((status) => reject(Object.assign(new Error(), { status }))) });
    signal.addEventListener("abort", () => request.fail(0));
    assert.ok(requests.every(({ isOpen }) => !isOpen), "one call at a time");
    requests.push(request);
  }) });
  return { chosen, requests, settingsSync, choose(what) { chosen.now = what; settingsSync.changed(); } };
}
const pass = (ms = 20) => new Promise((resolve) => setTimeout(resolve, ms));
async function until(claim) {
  while (!claim()) await pass(1);
}

test("choices made during a request wait for its end and are sent as they are then", async () => {
  const { requests, choose } = saving();
  choose("keys");
  await until(() => requests.length === 1);
  choose("high-contrast");
  await pass();
  choose("colour-blind");
  await pass();
  assert.equal(requests.length, 1);
  requests[0].answer();
  await until(() => requests.length === 2);
  requests[1].answer();
  await pass();
  assert.deepEqual(requests.map(({ value }) => value), ["keys", "colour-blind"]);
});

test("what failed is sent again, what was declined is not, and an answer that never comes is not waited for", async () => {
  for (const [status, times] of [[0, 2], [503, 2], [422, 1]]) {
    const { requests, choose } = saving();
    choose("keys");
    await until(() => requests.length === 1);
    requests[0].fail(status);
    if (times === 2) await until(() => requests.length === 2);
    await pass();
    assert.equal(requests.length, times, `after ${status}`);
    requests.at(-1).answer();
  }
  let asked = 0;
  const never = (signal) => new Promise((_, reject) => signal.addEventListener("abort", () => reject(new Error())));
  createSettingsSync({ settle_ms: 1, retry_ms: 1, patience_ms: 5, save: (signal) => ((asked += 1) === 1 ? never(signal) : Promise.resolve()) }).changed();
  await until(() => asked === 2);
  await pass();
  assert.equal(asked, 2);
});

test("a page that goes sends at once what waits, in place of a request without an answer, and nothing twice", async () => {
  const { requests, choose, settingsSync } = saving({ settle_ms: 1e6 });
  settingsSync.flush();
  assert.equal(requests.length, 0);
  choose("keys");
  settingsSync.flush();
  settingsSync.flush();
  assert.deepEqual(requests.map(({ value }) => value), ["keys"]);
  choose("high-contrast");
  settingsSync.flush();
  assert.deepEqual(requests.map(({ value, isOpen }) => [value, isOpen]), [["keys", false], ["high-contrast", true]]);
  requests[1].answer();
  await pass();
  assert.equal(requests.length, 2);
});
