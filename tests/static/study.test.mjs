import assert from "node:assert/strict";
import test from "node:test";
import { createRequest } from "../../static/common/api.js";
import { createStudyApi, outsideIds, studyName } from "../../static/study/api.js";
import { actionOf, assign, DEFAULT_KEYS, keyName, mayDrive, readKeys } from "../../static/study/keymap.js";
import { readPalette } from "../../static/study/palettes.js";
import { createIdleTimer } from "../../static/study/pause.js";
import * as replays from "../../static/study/replay.js";
import { createSettingsSync } from "../../static/study/settings_sync.js";
import { readChoices } from "../../static/study/settings.js";
import { apply, goesOn, initialState, isDriving, knowsTheEnd, screenOf } from "../../static/study/state.js";
import * as words from "../../static/study/words.js";
import { announcement } from "../../static/common/words.js";

const frame = (changes = {}) => ({ kind: "frame", episode: "e1", step: 0, rows: 2, cols: 3, grid: ["@.?", "#??"], position: [0, 0],
  discovered: 3, coverage: 0.5, heading: "east", reward: null, return: null, score: null, outcome: null, ...changes });
const about = (changes = {}) => ({ session: "s1", player: "human", level: "random", size: [2, 3], counts: false, rival: null, frame: frame(changes) });
const where = (changes = {}) => ({ study: "demo", title: "Demo", participant: "P-1", stage: "ranked", consent: { version: "1", text: "a\n\nb" }, questions: [],
  right: null, warm_up: { done: 1, of: 1 }, ranked: { done: 0, of: 2 }, tutorial: { done: true }, break_due: false, pause_after_s: 60, session: null, about: null,
  phase: null, settings: {}, debrief: null, ...changes });
const standing = (changes) => apply(initialState(), { kind: "where", where: where(changes) });
const playing = (changes = {}, of = {}) => standing({ session: "s1", phase: "ranked", about: about(changes), ...of });
const receive = (state, changes) => apply(state, { kind: "received", role: "player", message: frame(changes) });

test("the name of the study and the ids of another site are read from the address", () => {
  assert.equal(studyName("/study/demo"), "demo");
  assert.equal(studyName("/mars/study/demo-2/"), "demo-2");
  assert.equal(studyName("/"), "");
  assert.deepEqual(outsideIds("?PROLIFIC_PID=p%201&STUDY_ID=&x=" + "y".repeat(201)), { PROLIFIC_PID: "p 1" });
});

test("calls go below api, from wherever the page lies", async () => {
  const asked = [];
  const fetcher = async (path, options) => { asked.push([path, options.body]); return { ok: true, json: async () => ({}) }; };
  const study = createStudyApi(createRequest(fetcher, "../"), "demo");
  await study.join({ A: "1" });
  await study.giveUp("e1", 3);
  await study.terrain(2);
  assert.deepEqual(asked, [["../api/studies/demo/join", '{"outside_ids":{"A":"1"}}'], ["../api/studies/demo/give-up", '{"episode":"e1","step":3}'],
    ["../api/studies/demo/debrief/2", undefined]]);
});

test("the screen follows the stage, and the board stands before it while it is driven", () => {
  assert.equal(screenOf(initialState()), "loading");
  for (const stage of ["consent", "instructions", "questions", "debrief", "complete", "withdrawn"]) assert.equal(screenOf(standing({ stage })), stage);
  for (const stage of ["tutorial", "warm_up", "ranked"]) assert.equal(screenOf(standing({ stage })), "ready");
  assert.equal(screenOf(standing({ break_due: true })), "break");
  assert.equal(screenOf(playing()), "play");
  assert.equal(screenOf(apply(playing(), { kind: "problem", text: "no" })), "problem");
});

test("an ended episode keeps its card until it is passed, over the change of stage too, and not a stage longer", () => {
  const ended = playing({ outcome: "collided" }, { phase: "warm_up" });
  assert.equal(screenOf(ended), "play");
  assert.equal(isDriving(ended), false);
  assert.equal(screenOf(apply(ended, { kind: "passed", episode: "e1" })), "ready");
  assert.equal(screenOf(playing({ outcome: "explored" }, { phase: "ranked", stage: "debrief" })), "play");
  assert.equal(screenOf(playing({ outcome: "explored" }, { phase: "ranked", stage: "complete" })), "complete");
  assert.equal(screenOf(playing({ outcome: "explored" }, { phase: "tutorial", stage: "questions" })), "questions");
  assert.equal(screenOf(playing({}, { phase: "ranked", stage: "withdrawn" })), "withdrawn");
});

test("the next terrain follows at once only within a stage and without a break", () => {
  assert.equal(goesOn(where({ phase: "ranked" })), true);
  assert.equal(goesOn(where({ phase: "ranked", break_due: true })), false);
  assert.equal(goesOn(where({ phase: "warm_up" })), false);
});

test("the end is known once the server has told where it leads", () => {
  const ended = receive(playing(), { step: 1, outcome: "collided" });
  assert.equal(knowsTheEnd(ended), false);
  assert.equal(knowsTheEnd(apply(ended, { kind: "where", where: where({ phase: "ranked", about: about({ step: 1, outcome: "collided" }) }) })), true);
});

test("another tab's frames drive this board as well", () => {
  const one = receive(playing(), { step: 1, position: [0, 1] });
  assert.deepEqual(one.game.player.trail, [[0, 0], [0, 1]]);
  assert.equal(screenOf(receive(one, { episode: "e2" })), "play");
});

test("a pause ends with its episode", () => {
  const paused = apply(playing(), { kind: "paused", isPaused: true });
  assert.equal(paused.isPaused, true);
  assert.equal(receive(paused, { step: 1, outcome: "abandoned" }).isPaused, false);
  assert.equal(apply(standing({}), { kind: "paused", isPaused: true }).isPaused, false);
});

test("apply leaves the state before as it was", () => {
  const before = Object.freeze(playing());
  Object.freeze(before.game);
  apply(before, { kind: "where", where: where({ stage: "complete" }) });
  assert.equal(screenOf(before), "play");
});

test("a closed study says so in the place of the screen, and one who left reads what is kept", () => {
  assert.equal(screenOf(standing({ note: "closed" })), "problem");
  assert.equal(screenOf(standing({ stage: "withdrawn", note: "kept" })), "withdrawn");
  assert.equal(screenOf(apply(standing({ note: "closed" }), { kind: "where", where: where() })), "ready");
});

test("a key drives one way: a taken one changes places", () => {
  assert.equal(actionOf(DEFAULT_KEYS, "KeyW"), "north");
  assert.equal(actionOf(DEFAULT_KEYS, "KeyQ"), undefined);
  const keys = assign(DEFAULT_KEYS, "north", 1, "KeyI");
  assert.deepEqual(keys.north, ["ArrowUp", "KeyI"]);
  const swapped = assign(DEFAULT_KEYS, "north", 0, "KeyD");
  assert.deepEqual([swapped.north[0], swapped.east[1]], ["KeyD", "ArrowUp"]);
  assert.equal(new Set(Object.values(swapped).flat()).size, 8);
  for (const code of ["Tab", "Enter", "Escape", "Space", "ShiftLeft", "F5", "NumpadEnter"]) {
    assert.equal(mayDrive(code), false);
    assert.equal(typeof assign(DEFAULT_KEYS, "north", 0, code), "string");
  }
});

test("kept keys and colours are whole or none", () => {
  assert.deepEqual(readKeys(null), { ...DEFAULT_KEYS });
  assert.deepEqual(readKeys({ ...DEFAULT_KEYS, north: ["KeyS", "KeyW"] }), { ...DEFAULT_KEYS });
  const keys = assign(DEFAULT_KEYS, "west", 0, "KeyJ");
  assert.deepEqual(readKeys(JSON.parse(JSON.stringify(keys))), keys);
  assert.equal(readPalette("pink", false), "mars");
  assert.equal(readPalette(undefined, true), "high-contrast");
  assert.equal(readPalette("constructor", false), "mars");
  assert.deepEqual(readChoices({ pad: false, palette: "colour-blind" }, { wantsContrast: true, isTouch: true }),
    { modality: "touch", palette: "colour-blind", keys: { ...DEFAULT_KEYS }, pad: false });
});

test("a key is called what is printed on it", () => {
  assert.equal(keyName("ArrowUp"), "\u2191");
  assert.equal(keyName("KeyQ"), "Q");
  assert.equal(keyName("KeyQ", new Map([["KeyQ", "a"]])), "A");
  assert.equal(keyName("Numpad8"), "Num 8");
});

test("stillness is over after the protocol's seconds, and counted from the last touch", () => {
  let now = 0;
  const idle = createIdleTimer(() => now);
  now = 59_999;
  assert.equal(idle.isOver(60), false);
  now = 60_000;
  assert.equal(idle.isOver(60), true);
  idle.touch();
  assert.equal(idle.isOver(60), false);
});

/** A settings sync of `chosen.now`; `requests` are those that were begun, each ended by the test or by its signal. */
function saving(how = {}) {
  const chosen = { now: "mars" };
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

test("choices made while a call is on its way wait for its end and are told as they are then", async () => {
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

test("what did not get through is told again, what was declined is not, and an answer that never comes is not waited for", async () => {
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

test("a page that goes tells at once what waits, in place of a call on its way, and nothing twice", async () => {
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

test("the replay plays both runs in step, stops at the longer one's end and begins again", () => {
  const run = (count) => Array.from({ length: count }, (_, step) => frame({ step, discovered: step }));
  let replay = replays.toggled(replays.begun(0, { own: run(2), policy: { name: "ppo", frames: run(4) } }));
  for (let k = 0; k < 5; k++) replay = replays.stepped(replay);
  assert.deepEqual([replay.step, replay.isPlaying], [3, false]);
  assert.deepEqual(replays.boardAt(replay.runs.own, "You", replay.step).discovered, [0, 1]);
  assert.equal(replays.toggled(replay).step, 0);
  assert.deepEqual([replays.moved(replay, 99).step, replays.moved(replay, -1).step], [3, 0]);
  assert.equal(replays.boardAt([], "x", 0), null);
});

test("no sentence of a ranked terrain tells a score", () => {
  const { figures, go } = words.endCard(frame({ outcome: "explored", step: 30 }), where({ phase: "ranked" }));
  assert.deepEqual(figures.map(([name]) => name), ["Moves", "Coverage"]);
  assert.equal(go, "Next terrain");
  assert.deepEqual(words.endCard(frame({ outcome: "explored", score: 0.9 }), where({ phase: "warm_up", stage: "warm_up" })).figures.at(-1), ["Score", "0.900"]);
  assert.equal(words.endCard(frame({ outcome: "explored" }), where({ phase: "ranked", break_due: true })).go, "Go on");
});

test("nothing said of a ranked terrain tells a score", () => {
  assert.doesNotMatch(announcement(frame({ coverage: 0.4 }), frame({ coverage: 0.6, step: 9 })), /score/);
  assert.doesNotMatch(announcement(frame(), frame({ outcome: "explored", step: 9 })), /score/);
  assert.match(announcement(frame(), frame({ outcome: "explored", step: 9, score: 0.9 })), /score 0.900/);
});

test("progress counts the running terrain, and the whole way ends at one", () => {
  assert.equal(words.progress(where(), true), "Ranked: terrain 1 of 2");
  assert.equal(words.progress(where({ ranked: { done: 2, of: 2 } }), true), "Ranked: terrain 2 of 2");
  assert.equal(words.progress(where({ stage: "debrief" }), false), "Debrief");
  assert.equal(words.share(where({ stage: "complete", ranked: { done: 2, of: 2 } })), 1);
});

test("the map in words names runs of cells", () => {
  assert.deepEqual(words.mapInWords(frame()), ["rover, 1 free, 1 unknown", "1 rock, 2 unknown"]);
});

test("the coach speaks from the first move to the last cells", () => {
  const keys = { east: "D", south: "S" };
  assert.match(words.coach(frame(), keys)[1], /Press D or S/);
  assert.notDeepEqual(words.coach(frame({ step: 20, coverage: 0.4 }), keys), words.coach(frame({ step: 20, coverage: 0.95 }), keys));
});
