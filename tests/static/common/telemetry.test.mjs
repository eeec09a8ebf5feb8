import assert from "node:assert/strict";
import test from "node:test";
import { createStore } from "../../../static/common/storage.js";
import { createTelemetry, onScreen, tabStorage, BATCH_SIZE, MAX_WAITING } from "../../../static/common/telemetry.js";

/** A page's telemetry, which has said that it is visible: `sent` is what left, `answer()` the server's word on the first of `sent` that has none, `store.kept` what waits for the next load. */
function telemetry(isOpen, stored = []) {
  const sent = [];
  const on = { episode: "e1", step: 4, round_trip_ms: 7.5 };
  const connection = { isOpen: true };
  const store = { kept: undefined };
  const page = { isHidden: false };
  let answers = 0;
  const kept = createTelemetry({ context: () => on, isHidden: () => page.isHidden, now_ms: () => 100.04, tab: "this-tab", stored, store: (batches) => { store.kept = JSON.parse(JSON.stringify(batches)); },
    send: (message) => connection.isOpen && sent.push(message) > 0 });
  function answer(how = {}) {
    const { episode, events } = sent[answers++];
    kept.answered({ kind: "kept", episode, count: events.length, reason: null, ...how });
  }
  if (stored.length === 0) {
    kept.look();
    kept.flush();
    answer();
    sent.length = answers = 0;
  }
  connection.isOpen = isOpen;
  return { kept, sent, on, page, connection, store, answer,
    reconnect() { answers = sent.length; connection.isOpen = true; kept.reconnected(); } };
}
const times = (batches) => batches.map(({ events }) => events.map(({ client_ms }) => client_ms));

test("an event carries its key, the step on screen and the round trip, in its episode's batch", () => {
  const { kept, sent, on, answer } = telemetry(true);
  kept.note("keydown", { code: "KeyD", repeat: false, trusted: true, at_ms: 99.96 });
  on.episode = "e2";
  kept.note("blur");
  kept.flush();
  answer();
  answer();
  const ids = sent.map((each) => each.batch);
  const from = { page_load: sent[0].page_load, tab: "this-tab" };
  assert.match(from.page_load, /^[0-9a-f]{32}$/);
  assert.match(ids.join(" "), /^[0-9a-f]{32} [0-9a-f]{32}$/);
  assert.notEqual(ids[0], ids[1]);
  assert.deepEqual(sent, [
    { kind: "events", episode: "e1", batch: ids[0], ...from, events: [{ kind: "keydown", code: "KeyD", repeat: false, trusted: true, client_ms: 100, step: 4, round_trip_ms: 7.5 }] },
    { kind: "events", episode: "e2", batch: ids[1], ...from, events: ["visible", "blur"].map((kind) => ({ kind, code: null, repeat: null, trusted: null, client_ms: kind === "blur" ? 100 : 100.1, step: 4, round_trip_ms: 7.5 })) }]);
  assert.equal(kept.waiting(), 0);
});

test("without a connection events wait; then they leave in order, 200 at a time, the oldest lost beyond the most", () => {
  const { kept, sent, answer, reconnect } = telemetry(false);
  for (let k = 0; k < MAX_WAITING + 5; k++) kept.note("keydown", { at_ms: k });
  kept.flush();
  assert.equal(kept.waiting(), MAX_WAITING);
  reconnect();
  for (let k = 0; k < MAX_WAITING / BATCH_SIZE; k++) answer();
  assert.equal(kept.waiting(), 0);
  assert.deepEqual(new Set(sent.map(({ events }) => events.length)), new Set([BATCH_SIZE]));
  assert.deepEqual(times(sent).flat(), Array.from({ length: MAX_WAITING }, (_, k) => k + 5));
});

test("a load says with its first frame of an episode whether it is visible, and again when that changes, before anything else", () => {
  const { kept, sent, on, page } = telemetry(true);
  kept.look();
  page.isHidden = true;
  kept.note("keydown");
  on.episode = null;
  page.isHidden = false;
  kept.look();
  on.episode = "e1";
  kept.look();
  on.episode = "e2";
  page.isHidden = true;
  kept.look();
  kept.look();
  kept.sendAll();
  assert.deepEqual(sent.map(({ episode, events }) => [episode, events.map(({ kind }) => kind)]), [["e1", ["hidden", "keydown", "visible"]], ["e2", ["hidden"]]]);
});

test("a tab keeps its id and its batches from one load to the next; where storage is blocked each load is a tab of its own", () => {
  const kept = new Map();
  const storage = { getItem: (key) => kept.get(key) ?? null, setItem: (key, text) => void kept.set(key, text) };
  const load = () => tabStorage("a.key", createStore(() => storage));
  const first = load();
  first.store([{ batch: "b", events: [] }]);
  const second = load();
  assert.deepEqual([second.tab, second.stored], [first.tab, [{ batch: "b", events: [] }]]);
  const blocked = [1, 2].map(() => tabStorage("a.key", createStore(() => { throw new Error("blocked"); })));
  for (const { tab, stored, store } of blocked) {
    store([]);
    assert.match(tab, /^[0-9a-f]{32}$/);
    assert.deepEqual(stored, []);
  }
  assert.notEqual(blocked[0].tab, blocked[1].tab);
});

test("what no page of ours has stored is not believed", () => {
  const storage = { getItem: () => '[1, {"events": "none"}, null]', setItem() {} };
  const { tab, stored } = tabStorage("a.key", createStore(() => storage));
  assert.match(tab, /^[0-9a-f]{32}$/);
  assert.deepEqual(stored, []);
});

test("nothing is kept while no board is shown", () => {
  const { kept, on } = telemetry(true);
  on.episode = null;
  kept.note("keydown");
  assert.equal(kept.waiting(), 0);
});

test("one batch is under way at a time; what a flush asked for meanwhile follows its answer, what none asked for waits", () => {
  const { kept, sent, answer } = telemetry(true);
  kept.note("keydown", { at_ms: 1 });
  kept.flush();
  kept.note("keyup", { at_ms: 2 });
  kept.flush();
  kept.note("keydown", { at_ms: 3 });
  assert.deepEqual(times(sent), [[1]]);
  assert.equal(kept.waiting(), 3);
  answer();
  assert.deepEqual(times(sent), [[1], [2, 3]]);
  kept.note("keyup", { at_ms: 4 });
  answer();
  assert.deepEqual(times(sent), [[1], [2, 3]]);
  kept.flush();
  answer();
  assert.deepEqual(times(sent), [[1], [2, 3], [4]]);
  assert.equal(kept.waiting(), 0);
});

test("a batch under way when the connection broke is sent again, the very same, before anything newer", () => {
  const { kept, sent, answer, connection, reconnect } = telemetry(true);
  kept.note("keydown", { at_ms: 1 });
  kept.flush();
  connection.isOpen = false;
  kept.note("keyup", { at_ms: 2 });
  kept.flush();
  reconnect();
  assert.deepEqual(sent[1], sent[0]);
  answer();
  assert.deepEqual(times(sent), [[1], [1], [2]]);
  answer();
  assert.equal(kept.waiting(), 0);
  reconnect();
  assert.equal(sent.length, 3);
});

test("a batch that is not kept for a reason is dropped, one that is not kept for now is sent again", () => {
  const { kept, sent, answer } = telemetry(true);
  kept.note("keydown", { at_ms: 1 });
  kept.flush();
  answer({ count: 0 });
  assert.equal(kept.waiting(), 1);
  kept.flush();
  assert.deepEqual(times(sent), [[1], [1]]);
  answer({ count: 0, reason: "the study is closed" });
  assert.equal(kept.waiting(), 0);
  kept.flush();
  assert.equal(sent.length, 2);
  kept.answered({ kind: "kept", episode: "e1", count: 1, reason: null });
});

test("a page that goes sends everything and stores what no answer came for; the next load sends the same batches again", () => {
  const { kept, sent, store, answer } = telemetry(true);
  kept.note("keydown", { at_ms: 1 });
  kept.flush();
  kept.note("keyup", { at_ms: 2 });
  kept.leave();
  kept.leave();
  assert.deepEqual(times(sent), [[1], [2]]);
  assert.deepEqual(store.kept, sent);
  answer();
  assert.deepEqual(times(store.kept), [[2]]);
  const next = telemetry(false, store.kept);
  next.kept.note("focus", { at_ms: 0.5 });
  next.kept.flush();
  next.reconnect();
  next.answer();
  next.answer();
  assert.deepEqual(times(next.sent), [[2], [100, 0.5]]);
  assert.equal(next.sent[0].page_load, sent[0].page_load);
  assert.notEqual(next.sent[1].page_load, sent[0].page_load);
  assert.deepEqual([next.kept.waiting(), next.store.kept], [0, []]);
});

test("without a connection a page that goes stores all it has, and goes on in the same batches when it stays after all", () => {
  const { kept, sent, store, answer, reconnect } = telemetry(false);
  kept.note("keydown", { at_ms: 1 });
  kept.leave();
  kept.note("keyup", { at_ms: 2 });
  reconnect();
  assert.deepEqual(sent, store.kept);
  answer();
  answer();
  assert.deepEqual(times(sent), [[1], [2]]);
  assert.deepEqual([kept.waiting(), store.kept], [0, []]);
});

test("no two events of a page are the same, however coarse its clock", () => {
  const { kept, sent } = telemetry(true);
  for (let k = 0; k < 3; k++) for (const kind of ["keydown", "keyup"]) kept.note(kind, { code: "KeyD", at_ms: 200 });
  kept.note("keydown", { code: "KeyA", at_ms: 200 });
  kept.flush();
  assert.deepEqual(times(sent), [[200, 200, 200.1, 200.1, 200.2, 200.2, 200]]);
});

test("before a move everything leaves at once, in order, whatever is under way", () => {
  const { kept, sent, answer } = telemetry(true);
  for (let k = 1; k <= 3; k++) {
    kept.note("keydown", { at_ms: k });
    kept.sendAll();
  }
  assert.deepEqual(times(sent), [[1], [2], [3]]);
  kept.note("keyup", { at_ms: 4 });
  kept.flush();
  assert.deepEqual(times(sent), [[1], [2], [3]]);
  answer();
  answer();
  answer();
  assert.deepEqual(times(sent), [[1], [2], [3], [4]]);
});

test("what is on screen is what was painted of the episode, else its newest frame", () => {
  assert.deepEqual(onScreen(null, null, 3), { episode: null, step: null, round_trip_ms: 3 });
  assert.deepEqual(onScreen({ episode: "e2", step: 5 }, { episode: "e2", step: 4 }, 3), { episode: "e2", step: 4, round_trip_ms: 3 });
  assert.deepEqual(onScreen({ episode: "e2", step: 0 }, { episode: "e1", step: 87 }, null), { episode: "e2", step: 0, round_trip_ms: null });
});
