import assert from "node:assert/strict";
import { mock, test } from "node:test";
import { ApiError } from "../../../static/common/api.js";
import { createSessions, findBoard, modeOn, patiently, sessionWish, watchedInHash } from "../../../static/play/sessions.js";

test("each mode asks for its own kind of session", () => {
  const wish = { level: "random", size: 21, seed: null, rival: "ppo", player: "random" };
  assert.deepEqual(sessionWish("practice", wish), { level: "random", size: 21, player: "human", rival: "ppo" });
  assert.deepEqual(sessionWish("ranked", wish), { level: "random", size: 21, player: "human" });
  assert.deepEqual(sessionWish("watch", { ...wish, seed: 0 }), { level: "random", size: 21, seed: 0, player: "random", rival: "ppo" });
});

test("a terrain that is chosen is practice, unless it is watched", () => {
  const wish = { level: "random", map: null, size: 21, seed: null, rival: "ppo", player: "random" };
  const cases = [["ranked", {}, "ranked"], ["ranked", { seed: 0 }, "practice"], ["ranked", { map: "office" }, "practice"],
    ["practice", {}, "practice"], ["challenge", {}, "practice"], ["watch", { seed: 7 }, "watch"], ["watch", {}, "watch"]];
  for (const [mode, changes, wanted] of cases) assert.equal(modeOn(mode, { ...wish, ...changes }), wanted);
});

test("a map is asked for by its name alone", () => {
  const wish = { level: "map", map: "office", size: 21, seed: null, rival: "ppo", player: "random" };
  assert.deepEqual(sessionWish("practice", wish), { map: "office", player: "human", rival: "ppo" });
  assert.deepEqual(sessionWish("ranked", wish), { map: "office", player: "human" });
});

test("the address names what anybody may watch", () => {
  assert.equal(watchedInHash("#watch=00ff00ff00ff00ff"), "00ff00ff00ff00ff");
  assert.equal(watchedInHash("#watch=<script>"), null);
  assert.equal(watchedInHash("#s=ab_c-1234"), null);
});

/** Sessions over an API that answers as told, and what came of it. */
function restored({ hash = "", asked = null, kept = {}, api }) {
  const done = [];
  const storage = { getItem: (name) => kept[name] ?? null, setItem: (name, value) => { kept[name] = value; } };
  const full = { createSession: async () => { done.push("new board"); return about("new"); }, ...api };
  const sessions = createSessions({ api: full, storage, wish: () => ({ level: "random", size: 21, seed: null, rival: "ppo", player: "ppo" }),
    place: (_session, query, hash) => done.push(`${query ?? ""}${hash}`), dispatch: (event) => done.push(event.kind), onBegun: () => {} });
  const find = () => findBoard({ api: full, hash, entry: "", asked, start: async ({ mode }) => full.createSession({ mode }), storage, watch: async (episode) => { done.push(`watch ${episode}`); }, note: () => done.push("note") });
  const restore = async () => { const found = await patiently(find, () => done.push("link")); if (found) await sessions.resume(found); };
  return { restore, done };
}
const about = (session, challenges = null) => ({ session, challenges, player: "human", counts: false, watch: `${session}-watch`, frame: { episode: `${session}-episode`, step: 0, outcome: null } });
const unknown = async () => { throw new ApiError("unknown", 404); };

test("a reload goes on with the tab's own board, a copied address is watched, a new browser begins", async () => {
  const own = restored({ hash: "#watch=mine", kept: { "humanplay.session": "s1", "humanplay.watch": "mine" }, api: { about: async () => about("s1") } });
  await own.restore();
  assert.deepEqual(own.done, ["begun", "#watch=s1-watch"]);
  const copied = restored({ hash: "#watch=theirs", api: { mySession: async () => null } });
  await copied.restore();
  assert.deepEqual(copied.done, ["watch theirs"]);
  const fresh = restored({ api: { mySession: async () => null } });
  await fresh.restore();
  assert.deepEqual(fresh.done, ["new board", "begun", "#watch=new-watch"]);
  const gone = restored({ kept: { "humanplay.session": "s1" }, api: { about: unknown, mySession: async () => about("s2") } });
  await gone.restore();
  assert.deepEqual(gone.done, ["begun", "#watch=s2-watch"]);
});

test("a link that challenges stands for the board on which it was taken up, else for a new one", async () => {
  const replay = async (episode) => ({ run: { name: episode, actions: [] } });
  const createSession = async ({ challenges }) => about("new", challenges);
  const begun = ["begun", "#challenge=e000", "challenged"];
  for (const hash of ["#challenge=e000", ""]) {
    const again = restored({ hash, kept: { "humanplay.session": "s1" }, api: { replay, createSession: unknown, about: async () => about("s1", "e000") } });
    await again.restore();
    assert.deepEqual(again.done, begun);
  }
  const taken = restored({ hash: "#challenge=e000", kept: { "humanplay.session": "s1" }, api: { replay, createSession, about: async () => about("s1", "e111") } });
  await taken.restore();
  assert.deepEqual(taken.done, begun);
  const gone = restored({ hash: "#challenge=e000", api: { createSession: unknown, mySession: async () => about("s2") } });
  await gone.restore();
  assert.deepEqual(gone.done, ["note", "begun", "#watch=s2-watch"]);
  const untold = restored({ hash: "#challenge=e000", api: { replay: unknown, createSession } });
  await untold.restore();
  assert.deepEqual(untold.done, ["begun", "#challenge=e000", "notice"]);
});

test("an address tries an episode again from one of its moves, but drops no ranked one", async () => {
  const [acts, kept] = [[], { "humanplay.session": "s1" }];
  const episode = async () => ({ level: "random", rows: 7, cols: 9, seed: 3, actions: ["east", "south", "east"], outcome: "explored", steps: 3 });
  const createSession = async ({ size, seed, player }) => ({ ...about(`${player}-${size}-${seed}`), task: { successes: ["explored"] } });
  const api = { episode, createSession, about: async () => about("s1"), mySession: async () => null, act: async (session, move) => { acts.push([session, move]); } };
  const begun = restored({ hash: "#try=e000:2", kept, api });
  await begun.restore();
  assert.deepEqual(begun.done, ["begun", "#watch=human-7,9-3-watch", "notice"]);
  assert.deepEqual(acts.map(([session, { step, action }]) => [session, step, action]), [["human-7,9-3", 0, "east"], ["human-7,9-3", 1, "south"]]);
  assert.deepEqual(JSON.parse(kept["humanplay.tried"]), { episode: "human-7,9-3-episode", move: 3, before: 3 });
  const ranked = { ...about("s2"), kind: "ranked", counts: true, frame: { episode: "e", step: 4, outcome: null } };
  const open = restored({ hash: "#try=e000:2", api: { ...api, mySession: async () => ranked } });
  await open.restore();
  assert.deepEqual(open.done, ["begun", "?mode=ranked#watch=s2-watch", "notice"], "it goes on");
  const given = restored({ hash: "#try=e000:2", api: { ...api, episode: async () => ({ seed: null }) } });
  await given.restore();
  assert.deepEqual(given.done, ["notice", "begun", "#watch=human-21-undefined-watch"]);
});

test("an answer that does not come begins no board, which would abandon a ranked episode", async () => {
  for (const status of [0, 503]) {
    let asked = 0;
    const mySession = async () => { if (asked++ === 0) throw new ApiError("not now", status); return about("s1"); };
    const { restore, done } = restored({ api: { mySession } });
    await restore();
    assert.deepEqual(done, ["link", "begun", "#watch=s1-watch"]);
  }
  await assert.rejects(patiently(async () => { throw new TypeError("a mistake"); }, assert.fail), TypeError);
});

test("where nothing is to be chosen, nothing is asked for", () => {
  assert.deepEqual(sessionWish("practice", null), { player: "human" });
});

test("a board that has to be compiled says so until it begins", async () => {
  mock.timers.enable({ apis: ["setTimeout"] });
  /** @type {unknown[]} */
  const said = [];
  /** @type {(about: unknown) => void} */
  let answer = () => {};
  const api = { createSession: () => new Promise((resolve) => { answer = resolve; }), health: async () => ({ getting_ready: "getting ready: once" }) };
  const sessions = createSessions({ api, storage: { setItem() {} }, wish: () => null, place() {}, onBegun() {},
    dispatch: ({ kind, text }) => said.push([kind, text]) });
  const started = sessions.start("practice");
  mock.timers.tick(999);
  for (let turn = 0; turn < 20; turn += 1) await null;
  assert.deepEqual(said, []);
  mock.timers.tick(1);
  for (let turn = 0; turn < 20; turn += 1) await null;
  assert.deepEqual(said, [["notice", "Getting ready: once."]]);
  answer(about("new"));
  await started;
  assert.deepEqual(said.slice(1), [["begun", undefined], ["dismiss", "Getting ready: once."]]);
  mock.timers.reset();
});
