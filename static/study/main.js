// Wires the participant's page: messages -> apply -> one scheduled repaint. The only module of the study that knows all the others.
import { startBoards } from "../common/socket.js";
import { actionOf, startControls } from "../common/keyboard.js";
import { createTelemetry, onScreen, recordInputEvents } from "../common/telemetry.js";
import { createRepaint, by, paintLink, paintNotices } from "../common/page.js";
import { createMoveSender } from "../common/pending_moves.js";
import { keyName, showTask } from "../common/task.js";
import { createIdleTimer, createPause, startActions } from "./actions.js";
import { createNavigation, createStudyApi, invitationIn, outsideIds, studyName, withoutInvitation } from "./api.js";
import { createDebrief } from "./debrief.js";
import { createPages, createQuiz, startDialogs, startSupervision } from "./pages.js";
import { createSettings, createSettingsSync, PALETTES } from "./settings.js";
import { createPlayScreen } from "./play_screen.js";
import { apply, initialState, isDriving, knowsTheEnd, screenOf } from "./state.js";

const now_ms = () => performance.now();
const name = studyName(location.pathname);
const keep = (/** @type {string} */ what) => `mars.study.${name}.${what}`;

let state = initialState();
/** @type {Study.State | null} */
let painted = null;
/** @type {Study.Layout | undefined} */
let layout;
const study = createStudyApi(name);
const channel = "BroadcastChannel" in window ? new BroadcastChannel(`mars.study.${name}`) : null;
const idle = createIdleTimer(now_ms);
const frame = () => state.game.player?.frame;
const dialogs = startDialogs({ game: () => state.game, onClose: () => { if (state.isPaused) by("resume").focus(); } });
Object.defineProperty(window, "marsStudy", { value: Object.freeze({ get state() { return state; }, get painted() { return painted; }, get screen() { return screenOf(state); },
  get waiting() { return telemetry.waiting(); } }) });

const send = (/** @type {object} */ message) => connections.send("player", message);
const moves = createMoveSender({ send, now_ms, sendEvents: () => telemetry.sendAll() });
const telemetry = createTelemetry({ now_ms, send,
  stored: JSON.parse(sessionStorage.getItem(keep("events")) ?? "[]"), store: (batches) => sessionStorage.setItem(keep("events"), JSON.stringify(batches)),
  context: () => onScreen(screenOf(state) === "play" ? frame() : null, painted?.game.player?.frame, moves.round_trip_ms()) });
const settings = createSettings({ layout: () => layout, onChange: () => {
  paintKeys();
  settingsSync.changed();
  repaint(true);
} });
const settingsSync = createSettingsSync({ save(signal) {
  const { modality, palette, keys } = settings.get();
  return study.settings({ modality, palette, keys }, signal);
} });
const look = () => {
  const style = getComputedStyle(document.documentElement);
  const read = (/** @type {string} */ colour) => style.getPropertyValue(colour).trim();
  const { palette } = settings.get();
  return { palette, inks: PALETTES[palette].inks, accent: read("--accent"), rival: read("--rival"), font: read("--figures") };
};
const pages = createPages();
const paintKeys = () => pages.paintKeys(state.participant?.task.order ?? [], settings.get().keys, layout);
const playScreen = createPlayScreen({ look, keyOf: (action) => keyName(settings.get().keys[action][0], layout) });
const supervision = startSupervision({ supervise: study.supervise, dispatch });
const debrief = createDebrief({
  look, terrain: study.terrain, losses: study.losses, dispatch, index: () => state.replay?.index,
  warmUps: () => state.participant?.debrief?.warm_up_terrains ?? 0,
});
const quiz = createQuiz((answers) => navigation.go(() => study.answers(answers), "questions"));
const navigation = createNavigation({ study, dispatch, ids: outsideIds(location.search), invitation: invitationIn(location.search), channel, onJoined(participant) {
  history.replaceState(history.state, "", withoutInvitation(location.href));
  settings.begin(participant.task.keys);
  showTask(participant.task);
  if (participant.settings.keys) settings.adopt(participant.settings);
  else settingsSync.changed();
} });
const pause = createPause({ idle, dispatch, note: telemetry.note, flush: telemetry.flush, episode: () => frame()?.episode ?? "",
  announce: (text) => { by("announcer").textContent = text; }, storage: sessionStorage, key: keep("paused") });
const connections = startBoards({
  moves, telemetry, dispatch, isLost: () => state.game.link === "lost",
  idle_ms: () => (idle.isOver(60) ? Infinity : 0), onBack: navigation.refresh,
  onAnswered(_, message) {
    if (message.kind === "refused" || (message.kind === "kept" && message.reason !== null)) navigation.refresh();
  },
  async beforeRetry(_, session) {
    const participant = await study.me();
    dispatch({ kind: "participant", participant });
    return participant.session === session;
  },
});
const repaint = createRepaint((isWhole) => paint(isWhole ? null : painted));

/** Apply an event: the only place where the state changes, but for a pause that goes on.
 * @param {Study.Event} event */
function dispatch(event) {
  const before = state;
  state = apply(state, event);
  if (state === before) return;
  connections.sync(state.game);
  const [was, is] = [before.game.player?.frame ?? null, frame() ?? null];
  if (is && is !== was) {
    const said = state.game.task?.announcement(was, is);
    if (said && screenOf(state) === "play") by("announcer").textContent = said;
    if (is.episode !== was?.episode) begun(is);
    // another tab began an episode, or this one has ended: the server knows where that leads
    if ((is.outcome && !knowsTheEnd(state)) || state.participant?.about?.frame.episode !== is.episode) navigation.refresh();
  }
  if (screenOf(state) === "debrief" && screenOf(before) !== "debrief" && state.participant?.debrief?.warm_up_terrains) debrief.load(state.looksBack ? state.participant.debrief.warm_up_terrains : 0);
  repaint();
}

/** Begin an episode on the board: moves of the last one are void, and a pause that a reload interrupted goes on.
 * @param {Frame} first */
function begun({ episode }) {
  moves.drop();
  idle.touch();
  if (pause.wasPaused(episode)) state = apply(state, { kind: "paused", isPaused: true });
}

/** @param {Study.State | null} before what is painted; null paints everything */
function paint(before) {
  const { participant, game } = painted = state;
  pages.paint(state, before);
  if (participant && screenOf(state) === "questions" && before?.participant !== participant) quiz.paint(participant);
  if (participant && participant !== before?.participant) {
    supervision.paint(participant);
    if (!before?.participant) paintKeys();
  }
  playScreen.paint(state, before);
  debrief.paint(state, before);
  if (game.notices !== before?.game.notices) paintNotices(by("notices"), game.notices, (id) => dispatch({ kind: "dismiss", id }));
  paintLink(by("link"), game.link === "connecting" && participant && !participant.session ? "open" : game.link, "connected");
}

const actions = startActions({ state: () => state, study, navigation, resume: () => pause.set(false), isBlocked: dialogs.isOpen,
  look: (looksBack) => dispatch({ kind: "looked-back", looksBack }),
  onPassed(episode) {
    sessionStorage.setItem(keep("passed"), episode);
    dispatch({ kind: "passed", episode });
  } });
const mayDrive = () => isDriving(state) && !dialogs.isOpen();
recordInputEvents({ page: window, frames: [], pad: by("dock"), note: telemetry.note, flush: telemetry.flush, leave: telemetry.leave, onActivity: () => { if (!state.isPaused) idle.touch(); },
  drives: (code) => screenOf(state) === "play" && !dialogs.isOpen() && actionOf(settings.get().keys, code) !== undefined });
startControls({
  page: window, pad: by("dock"), frames: [], onEnter: actions.onEnter,
  actionOf: (code) => (mayDrive() ? actionOf(settings.get().keys, code) : undefined),
  onAct(action, timing, pressed_ms) {
    const on = frame();
    if (!on || !mayDrive()) return;
    if (state.isPaused) return pause.set(false);
    settings.drove(timing.input === "touch" ? "touch" : "keyboard");
    moves.press(on, action, timing, pressed_ms);
  },
});
setInterval(() => {
  telemetry.flush();
  if (isDriving(state) && !state.isPaused && idle.isOver(state.participant?.pause_after_s ?? 60)) pause.set(true);
}, 1000);
window.addEventListener("pagehide", settingsSync.flush);
document.addEventListener("visibilitychange", () => (document.hidden ? settingsSync.flush() : navigation.refresh()));
channel?.addEventListener("message", () => navigation.refresh());
new ResizeObserver(() => repaint(true)).observe(by("main"));

/** @type {Navigator & {keyboard?: {getLayoutMap?: () => Promise<Study.Layout>}}} */ (navigator).keyboard?.getLayoutMap?.().then((map) => {
  layout = map;
  settings.paint();
  paintKeys();
}, () => {});
const passed = sessionStorage.getItem(keep("passed"));
if (passed) dispatch({ kind: "passed", episode: passed });
paintKeys();
repaint();
navigation.join();
