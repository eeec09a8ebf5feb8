// @ts-check
// Wires the participant's page: messages -> apply -> one scheduled repaint. The only module of the study that knows all the others.
import { createApi, createCall } from "../common/api.js";
import { startControls } from "../common/controls.js";
import { createLinks } from "../common/connections.js";
import { paintNotices } from "../common/panels.js";
import { startPulse } from "../common/heartbeat.js";
import { announcement } from "../common/words.js";
import { createStudy, outsideIds, studyName } from "./api.js";
import { createDebrief } from "./debrief.js";
import { startDialogs } from "./dialogs.js";
import { createDriver } from "./driver.js";
import { createIdle } from "./idle.js";
import { actionOf, keyName } from "./keymap.js";
import { createPages } from "./pages.js";
import { PALETTES } from "./palettes.js";
import { createQuiz } from "./quiz.js";
import { createSaver } from "./choices.js";
import { startSenses } from "./input_events.js";
import { createSettings } from "./settings.js";
import { apply, goesOn, initialState, isDriving, knowsTheEnd, screenOf } from "./state.js";
import { createTable } from "./play_screen.js";
import { createTelemetry } from "./telemetry.js";
import { createWay } from "./progress.js";

/** @typedef {import("./state.js").Event} Event */
const by = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));
const ROOT = "../";
const now_ms = () => performance.now();
const name = studyName(location.pathname);
const keep = (/** @type {string} */ what) => `mars.study.${name}.${what}`;

let state = initialState();
let isScheduled = false;
/** The next repaint is also of what did not change. */
let isWhole = false;
/** @type {import("./state.js").State | null} */
let painted = null;
/** @type {any} */
let layout;
const fetcher = (/** @type {any} */ path, /** @type {any} */ options) => fetch(path, options);
const api = createApi(fetcher, ROOT);
const study = createStudy(createCall(fetcher, ROOT), name);
const channel = "BroadcastChannel" in window ? new BroadcastChannel(`mars.study.${name}`) : null;
const idle = createIdle(now_ms);
const frame = () => state.table.player?.frame;
const dialogs = startDialogs(document, { frame, onClose: () => state.isPaused && by("resume").focus() });
Object.defineProperty(window, "marsStudy", { value: Object.freeze({ get state() { return state; }, get painted() { return painted; }, get screen() { return screenOf(state); },
  get waiting() { return telemetry.waiting(); } }) });

const driver = createDriver({ send: (message) => links.send("player", message), now_ms });
const telemetry = createTelemetry({ now_ms, send: (message) => links.send("player", message),
  stored: JSON.parse(sessionStorage.getItem(keep("events")) ?? "[]"), store: (batches) => sessionStorage.setItem(keep("events"), JSON.stringify(batches)),
  context: () => ({ episode: screenOf(state) === "play" ? frame()?.episode ?? null : null, step: painted?.table.player?.frame.step ?? null, round_trip_ms: driver.round_trip_ms() }) });
const settings = createSettings(document, { storage: localStorage, layout: () => layout, onChange: (choices) => {
  pages.paintKeys(choices.keys, layout);
  saver.tell();
  repaint(true);
} });
const saver = createSaver({ save(signal) {
  const { modality, palette, keys } = settings.get();
  return study.settings({ modality, palette, keys }, signal);
} });
const look = () => {
  const style = getComputedStyle(document.documentElement);
  const read = (/** @type {string} */ colour) => style.getPropertyValue(colour).trim();
  const { soil, inks } = PALETTES[settings.get().palette];
  return { soil, inks, accent: read("--accent"), rival: read("--rival"), font: read("--figures") };
};
const pages = createPages(document);
const table = createTable(document, { look, keys: () => ({ east: keyName(settings.get().keys.east[0], layout), south: keyName(settings.get().keys.south[0], layout) }) });
const debrief = createDebrief(document, { look, terrain: study.terrain, dispatch, replay: () => state.replay });
const quiz = createQuiz(document, (answers) => way.take(() => study.answers(answers), "questions"));
const way = createWay({ study, dispatch, ids: outsideIds(location.search), channel, onJoined(where) {
  if (where.settings.keys) settings.adopt(where.settings);
  else saver.tell();
  pages.paintKeys(settings.get().keys, layout);
} });
const links = createLinks({
  base: new URL(ROOT, location.href).href,
  onMessage(_, message) {
    driver.heard(message);
    if (message.kind === "refused" || (message.kind === "kept" && message.reason !== null)) way.refresh();
    if (message.kind === "kept") telemetry.answered(message);
    else dispatch({ kind: "received", seat: "player", message });
  },
  onLink(_, link) {
    if (link === "lost") driver.drop();
    else telemetry.reconnected();
    dispatch({ kind: "link", link });
  },
  async beforeRetry(_, session) {
    const where = await study.me();
    dispatch({ kind: "where", where });
    return where.session === session;
  },
});

/**
 * The one door to the state.
 * @param {Event} event
 */
function dispatch(event) {
  const before = state;
  state = apply(state, event);
  if (state === before) return;
  links.sync(state.table);
  const [was, is] = [before.table.player?.frame ?? null, frame() ?? null];
  if (is && is !== was) {
    const said = announcement(was, is);
    if (said && screenOf(state) === "play") by("announcer").textContent = said;
    if (is.episode !== was?.episode) begun(is);
    // another tab began an episode, or this one has ended: the server knows where that leads
    if ((is.outcome && !knowsTheEnd(state)) || state.where?.about?.frame.episode !== is.episode) way.refresh();
  }
  if (screenOf(state) === "debrief" && screenOf(before) !== "debrief" && state.where?.debrief?.warm_up_terrains) debrief.load(0);
  repaint();
}

/**
 * An episode is on the board: moves of the last one are void, and a pause that a reload cut goes on.
 * @param {import("../common/messages.js").Frame} first
 */
function begun({ episode }) {
  driver.drop();
  idle.touch();
  if (sessionStorage.getItem(keep("paused")) === episode) state = apply(state, { kind: "paused", isPaused: true });
}

/**
 * Schedules the one repaint.
 * @param {boolean} [isAll] also what did not change: sizes or colours did
 */
function repaint(isAll = false) {
  isWhole ||= isAll;
  if (isScheduled) return;
  isScheduled = true;
  requestAnimationFrame(() => {
    isScheduled = false;
    const before = isWhole ? null : painted;
    isWhole = false;
    painted = state;
    pages.paint(state, before);
    if (state.where && screenOf(state) === "questions" && before?.where !== state.where) quiz.paint(state.where);
    table.paint(state, before);
    debrief.paint(state, before);
    if (state.table.notices !== before?.table.notices) paintNotices(by("notices"), state.table.notices, (id) => dispatch({ kind: "dismiss", id }));
    by("link").dataset.link = state.table.link === "connecting" && state.where && !state.where.session ? "open" : state.table.link;
    by("link").lastElementChild.textContent = { connecting: "connecting", open: "connected", lost: "connection lost, trying again" }[/** @type {"open"} */ (by("link").dataset.link)];
  });
}

/** @param {boolean} isPaused */
function pause(isPaused) {
  telemetry.note(isPaused ? "pause" : "resume");
  idle.touch();
  if (isPaused) sessionStorage.setItem(keep("paused"), frame()?.episode ?? "");
  else sessionStorage.removeItem(keep("paused"));
  by("announcer").textContent = isPaused ? "Paused. Press a driving key or Go on." : "Going on.";
  dispatch({ kind: "paused", isPaused });
  telemetry.flush();
}
function passEnd() {
  const ended = frame();
  const { where } = state;
  if (!ended || !where || !knowsTheEnd(state) || way.isBusy()) return;
  if (where.phase === "tutorial") return leaveTutorial();
  if (goesOn(where)) return goNext();
  sessionStorage.setItem(keep("passed"), ended.episode);
  dispatch({ kind: "passed", episode: ended.episode });
}
const goNext = () => way.take(() => study.next(), state.where?.stage);
const leaveTutorial = () => way.take(async () => {
  const on = frame();
  if (on && !on.outcome) await study.giveUp(on.episode, on.step);
  return study.advance("tutorial");
}, "tutorial");

/** Enter presses the screen's button, unless it belongs to another one. */
function onEnter() {
  const focused = document.activeElement;
  if (dialogs.isOpen()) return false;
  const main = { play: state.isPaused ? by("resume") : frame()?.outcome ? by("next") : null, ready: by("begin"), break: by("end-break"),
    instructions: by("to-tutorial") }[/** @type {"play"} */ (screenOf(state))];
  if (!main || (focused?.matches("button, a, input, select") && focused !== main)) return false;
  main.click();
  return true;
}

const mayDrive = () => isDriving(state) && !dialogs.isOpen();
startSenses({ page: window, pad: by("dock"), note: telemetry.note, flush: telemetry.flush, leave: telemetry.leave, onActivity: () => !state.isPaused && idle.touch(),
  drives: (code) => screenOf(state) === "play" && !dialogs.isOpen() && actionOf(settings.get().keys, code) !== undefined });
startControls({
  page: window, pad: by("dock"), frames: [], onEnter,
  actionOf: (code) => (mayDrive() ? actionOf(settings.get().keys, code) : undefined),
  onAct(action, timing) {
    const on = frame();
    if (!on || !mayDrive()) return;
    if (state.isPaused) return pause(false);
    settings.drove(timing.input === "touch" ? "touch" : "keyboard");
    telemetry.flush();
    driver.press(on, action, timing);
  },
});
startPulse({
  silence_ms: links.silence_ms, idle_ms: () => (idle.isOver(60) ? Infinity : 0), ask: api.health,
  onSuccess: () => { if (state.table.link === "lost") { links.restart(); way.refresh(); } },
  onFailure: () => { driver.drop(); dispatch({ kind: "link", link: "lost" }); },
});
setInterval(() => {
  telemetry.flush();
  if (isDriving(state) && !state.isPaused && idle.isOver(state.where?.pause_after_s ?? 60)) pause(true);
}, 1000);
window.addEventListener("offline", () => dispatch({ kind: "link", link: "lost" }));
window.addEventListener("online", () => links.restart());
window.addEventListener("pagehide", saver.flush);
document.addEventListener("visibilitychange", () => (document.hidden ? saver.flush() : way.refresh()));
channel?.addEventListener("message", () => way.refresh());

/** @type {Record<string, () => unknown>} */
const CLICKS = {
  retry: () => location.reload(),
  agree: () => way.take(() => study.consent(state.where?.consent.version ?? "", true), "consent"),
  "to-tutorial": () => way.take(async () => { await study.advance("instructions"); return study.next(); }, "instructions"),
  begin: goNext, "end-break": goNext, next: passEnd, again: goNext, skip: leaveTutorial, resume: () => pause(false),
  finish: () => way.take(() => study.advance("debrief"), "debrief"),
  "give-up-now"() {
    by("give-up").close();
    const on = frame();
    if (on) way.take(() => study.giveUp(on.episode, on.step), state.where?.stage);
  },
  "leave-now"() {
    by("leave").close();
    const { where } = state;
    way.take(() => (where?.stage === "consent" ? study.consent(where.consent.version, false) : study.withdraw()), where?.stage);
  },
  async copy() {
    const isCopied = await navigator.clipboard?.writeText(by("code").textContent).then(() => true, () => false);
    if (!isCopied) getSelection()?.selectAllChildren(by("code"));
    by("copied").textContent = isCopied ? "Copied." : "The code is selected: copy it with your browser.";
  },
};
for (const [id, work] of Object.entries(CLICKS)) by(id).addEventListener("click", work);
new ResizeObserver(() => repaint(true)).observe(by("main"));

/** @type {any} */ (navigator).keyboard?.getLayoutMap?.().then((/** @type {any} */ map) => {
  layout = map;
  settings.paint();
  pages.paintKeys(settings.get().keys, layout);
}, () => {});
const passed = sessionStorage.getItem(keep("passed"));
if (passed) dispatch({ kind: "passed", episode: passed });
pages.paintKeys(settings.get().keys, layout);
repaint();
way.join();
