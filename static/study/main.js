// Wires the participant's page: messages -> apply -> one scheduled repaint. The only module of the study that knows all the others.
import { startBoards } from "../common/socket.js";
import { createClock } from "../common/clock.js";
import { codesOf, partOf, startControls } from "../common/keyboard.js";
import { paintKeys as paintKeyLines, sameKeys } from "../common/keymap.js";
import { createTelemetry, onScreen, tabStorage } from "../common/telemetry.js";
import { createRepaint, by, paintLink, paintNotices, reader } from "../common/page.js";
import { createMoveSender } from "../common/pending_moves.js";
import { tabStore } from "../common/storage.js";
import { LANGUAGE, t } from "../common/texts.js";
import { forbidden, keyName, showTask } from "../common/task.js";
import { announce, idle, isDialogOpen, keep, onEnter, pause, recordPauses } from "./actions.js";
import { load, paintDebrief } from "./debrief.js";
import { paintBlocks } from "./block.js";
import { paintPages } from "./pages.js";
import { paintPlayScreen } from "./play_screen.js";
import { createSettings, createSettingsSync, PALETTES } from "./settings.js";
import { isDriving, knowsTheEnd, screenOf } from "./state.js";
import { channel, dispatch, frame, join, refresh, showLoss, state, study, whenChanged } from "./store.js";

const now_ms = () => performance.now();
/** @type {Study.State | null} */
let painted = null;
Object.defineProperty(window, "study", { value: Object.freeze({ get state() { return state; }, get painted() { return painted; }, get screen() { return screenOf(state); },
  get waiting() { return telemetry.waiting(); } }) });

const send = (/** @type {object} */ message) => connections.send("player", message);
const moves = createMoveSender({ send, now_ms, sendEvents: () => telemetry.sendAll() });
const telemetry = createTelemetry({ now_ms, send, isHidden: () => document.hidden, ...tabStorage(keep("events")),
  context: () => onScreen(screenOf(state) === "play" ? frame() : null, painted?.game.player?.frame, moves.round_trip_ms()) });
const clock = createClock({ place: by("field"), telemetry, frames: () => state.participant?.task.clock ?? null,
  board: () => (screenOf(state) === "play" ? state.game.player : null) });
const settings = createSettings({ onLayout: () => paintKeys(), onChange: () => {
  paintKeys();
  settingsSync.changed();
  repaint(true);
} });
const settingsSync = createSettingsSync({ save(signal) {
  const { modality, palette, keys } = settings.get();
  return study.settings({ modality, palette, keys, stage: state.participant?.stage }, signal);
} });
const look = () => {
  const read = reader(document.documentElement);
  const { palette } = settings.get();
  return { palette, inks: PALETTES[palette].inks, accent: read("--accent"), rival: read("--rival"), font: read("--figures") };
};
const paintKeys = () => state.participant && paintKeyLines(state.participant.task, settings.get().keys, settings.layout());
const keyOf = (/** @type {Action} */ action) => keyName(settings.get().keys[action][0], settings.layout());
recordPauses(telemetry);
const connections = startBoards({
  moves, telemetry, dispatch, isLost: () => state.game.link === "lost",
  onBack: refresh,
  onAnswered(_, message) {
    if (message.kind === "refused" || (message.kind === "kept" && message.reason !== null)) refresh();
  },
  async beforeRetry(_, session) {
    try {
      const participant = await study.me();
      dispatch({ kind: "participant", participant });
      return participant.session === session;
    } catch (error) {
      if (showLoss(error)) return false;
      throw error;
    }
  },
});
const repaint = createRepaint((isWhole) => paint(isWhole ? null : painted));

whenChanged((before) => {
  takeKeys(before.participant, state.participant);
  connections.sync(state.game);
  const [was, is] = [before.game.player?.frame ?? null, frame() ?? null];
  if (is && is !== was) {
    const said = state.game.task?.announcement(was, is);
    if (said && screenOf(state) === "play") announce(said);
    if (is.episode !== was?.episode) begun(is);
    // another tab began an episode, or this one has ended: the server knows where that leads
    if ((is.outcome && !knowsTheEnd(state)) || state.participant?.about?.frame.episode !== is.episode) refresh();
  }
  if (screenOf(state) === "debrief" && screenOf(before) !== "debrief" && state.participant?.debrief?.warm_up_terrains) load(state.looksBack ? state.participant.debrief.warm_up_terrains : 0);
  repaint();
});

/** Take the keys of the arm to which somebody was assigned just now, which is before the instructions.
 * @param {Study.Participant | null} before @param {Study.Participant | null} participant */
function takeKeys(before, participant) {
  if (before?.stage !== "consent" || !participant || participant.stage === "consent") return;
  if (sameKeys(before.task.keys, participant.task.keys) && sameKeys(before.settings.keys, participant.settings.keys)) return;
  settings.begin(participant.task.keys);
  settings.adopt(participant.settings);
  settingsSync.changed();
}

/** @returns {Promise<Study.Participant>} what never comes, since the page is asked for again */
function reload() {
  location.reload();
  return new Promise(() => {});
}

/** Begin an episode on the board: moves of the last one are void, and a pause that a reload interrupted goes on.
 * @param {Frame} first */
function begun({ episode }) {
  moves.drop();
  idle.touch();
  if (tabStore.getItem(keep("paused")) === episode) {
    telemetry.note("pause");
    dispatch({ kind: "paused", isPaused: true });
  }
}

/** @param {Study.State | null} before what is painted; null paints everything */
function paint(before) {
  const { participant, game } = painted = state;
  paintPages(before);
  paintBlocks(before);
  if (participant && !sameKeys(participant.task.keys, before?.participant?.task.keys)) paintKeys();
  const colours = look();
  paintPlayScreen(before, colours, keyOf);
  clock.paint();
  paintDebrief(before, colours);
  if (game.notices !== before?.game.notices) paintNotices(by("notices"), game.notices, (id) => dispatch({ kind: "dismiss", id }));
  paintLink(by("link"), game.link === "connecting" && participant && !participant.session ? "open" : game.link, t("bar.connected", "connected"));
  by("link").hidden = state.problem !== null;
}

const mayDrive = () => isDriving(state) && !isDialogOpen();
startControls({
  pad: by("dock"), frames: [], onEnter, telemetry: clock.telemetry, onActivity: () => { if (!state.isPaused) idle.touch(); },
  codeOf: (event) => (screenOf(state) === "play" && !isDialogOpen() ? codesOf(event).find((code) => partOf(settings.get().keys, code)) : undefined),
  actionOf: (code) => (mayDrive() ? partOf(settings.get().keys, code) : undefined),
  onAct(action, timing, pressed_ms) {
    const on = frame();
    if (!on || !mayDrive()) return;
    if (state.isPaused) return pause(false);
    settings.drove(timing.input === "touch" ? "touch" : "keyboard");
    if (clock.isOn()) return clock.goOn();
    const refusal = state.participant && moves.pending().length === 0 ? forbidden(state.participant.task, on, action) : null;
    if (refusal !== null) {
      announce(`${refusal}.`);
      return dispatch({ kind: "notice", text: `${refusal}.`, tone: "note" });
    }
    moves.press(on, action, timing, pressed_ms);
  },
});
setInterval(() => {
  telemetry.flush();
  if (isDriving(state) && !state.isPaused && idle.isOver(state.participant?.pause_after_s ?? 60)) (clock.isOn() ? clock.pause() : pause(true));
}, 1000);
window.addEventListener("pagehide", settingsSync.flush);
document.addEventListener("visibilitychange", () => (document.hidden ? settingsSync.flush() : refresh()));
channel?.addEventListener("message", () => refresh());
new ResizeObserver(() => repaint(true)).observe(by("main"));

const passed = tabStore.getItem(keep("passed"));
if (passed) dispatch({ kind: "passed", episode: passed });
paintKeys();
repaint();
join(async (participant) => {
  const { language } = participant.settings;
  if (language && language !== LANGUAGE) return reload(); // they came by a link from another device, where they had chosen
  settings.begin(participant.task.keys);
  showTask(participant.task, true);
  if (participant.settings.keys) settings.adopt(participant.settings);
  else settingsSync.changed();
  const { stage, device, consent } = participant;
  const isUnfit = device === "computer" && !matchMedia("(any-pointer: fine)").matches;
  return stage === "consent" && isUnfit ? study.consent(consent.version, false, true) : participant;
});
