// @ts-check
// Wires everything: messages -> apply -> one scheduled repaint. The only module that knows all the others.
import { createApi } from "../common/api.js";
import { startControls } from "../common/controls.js";
import { createJourney, sessionInHash } from "./sessions.js";
import { createLinks } from "../common/connections.js";
import { createPainter } from "./painter.js";
import { createPanel, offerPolicies, paintHumanLevel } from "../common/panels.js";
import { startPace } from "./pace.js";
import { answeredBy, dropped, emptyPipeline, nextStep, sent } from "../common/pending_moves.js";
import { act } from "../common/messages.js";
import { createSheet } from "./terrain_dialog.js";
import { startPulse } from "../common/heartbeat.js";
import { apply, initialState } from "../common/game_state.js";
import { createViews } from "./views.js";
import { announcement } from "../common/words.js";

/**
 * @typedef {import("../common/game_state.js").Event} Event
 * @typedef {import("../common/game_state.js").Seat} Seat
 */
const by = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));
const SEATS = /** @type {const} */ (["player", "rival"]);

let state = initialState();
let line = emptyPipeline();
let isScheduled = false;
let actedAt_ms = performance.now();
Object.defineProperty(window, "mars", { value: Object.freeze({ get state() { return state; }, get latencies() { return painter.latencies(); } }) });

const panels = Object.fromEntries(SEATS.map((seat) => [seat, createPanel(
  /** @type {HTMLElement} */ (document.querySelector(`[data-seat=${seat}]`)), by("board-template"))]));
const api = createApi((path, options) => fetch(path, options));
const views = createViews({ page: document, panels: SEATS.map((seat) => panels[seat]), storage: localStorage, onChange: () => repaint(true) });

const think = /** @type {HTMLInputElement} */ (by("think"));
think.checked = localStorage.getItem("mars.thoughts") !== "false";
think.addEventListener("change", () => { localStorage.setItem("mars.thoughts", String(think.checked)); repaint(true); });

const painter = createPainter({ page: document, panels, views, rivalName: () => sheet.wish().rival, showsThoughts: () => think.checked, dismiss: (id) => dispatch({ kind: "dismiss", id }) });

const sheet = createSheet(by("sheet"), {
  onStart: (wish) => journey.start(state.mode, wish),
  onWrong: (text) => dispatch({ kind: "notice", text }),
  onPad: (isShown) => { localStorage.setItem("mars.pad", String(isShown)); document.body.dataset.pad = String(isShown); },
});
const journey = createJourney({
  api, dispatch, wish: sheet.wish,
  recall: () => sessionInHash(location.hash) ?? sessionStorage.getItem("mars.session"),
  remember(session) {
    sessionStorage.setItem("mars.session", session);
    history.replaceState(null, "", `#s=${session}`);
  },
  onBegun(about) {
    sheet.show(about);
    sheet.forgetSeed();
    loadHumanLevel();
  },
});
const links = createLinks({
  base: document.baseURI,
  onMessage(seat, message) {
    if (seat === "player") settle(message);
    dispatch({ kind: "received", seat, message });
  },
  onLink(seat, link) {
    if (link === "lost") line = dropped(line);
    if (seat === "player") dispatch({ kind: "link", link });
  },
  async beforeRetry(seat, session) {
    try {
      const about = await api.about(session);
      if (seat === "player") dispatch({ kind: "begun", about });
      return true;
    } catch (error) {
      if (/** @type {any} */ (error).status !== 404) throw error;
      if (seat === "player") journey.restore();
      return false;
    }
  },
});

/**
 * Moves that this message answers leave the line.
 * @param {import("../common/messages.js").FromServer} message
 */
function settle(message) {
  if (message.kind === "refused" || message.kind === "error") line = dropped(line);
  if (message.kind !== "frame") return;
  const { line: rest, answered } = answeredBy(line, message);
  line = rest;
  painter.answered(answered);
}

/**
 * The one door to the state.
 * @param {Event} event
 */
function dispatch(event) {
  const before = state;
  state = apply(state, event);
  if (state === before) return;
  if (event.kind === "begun") line = dropped(line);
  links.sync(state);
  const frame = state.player?.frame;
  if (frame && frame !== before.player?.frame) {
    const said = announcement(before.player?.frame ?? null, frame);
    if (said) by("announcer").textContent = said;
    if (state.mode === "ranked" && frame.outcome) journey.replay(state);
    if (frame.outcome && !before.player?.frame.outcome) loadHumanLevel();
  }
  repaint();
}

/**
 * Schedules the one repaint.
 * @param {boolean} [isAll] also what did not change: the page was resized
 */
function repaint(isAll = false) {
  if (isAll) painter.forget();
  if (isScheduled) return;
  isScheduled = true;
  requestAnimationFrame(() => {
    isScheduled = false;
    painter.paint(state);
  });
}

const goNext = () => state.player && journey.next(state.player.session, null);
/** Enter means "next terrain" once the episode is over, unless it belongs to another button. */
function onEnter() {
  const focused = document.activeElement;
  if (!state.player?.frame.outcome || (focused?.matches("button, a") && focused !== panels.player.part.next)) return false;
  goNext();
  return true;
}

startControls({
  page: window, pad: by("dock"), frames: SEATS.map((seat) => panels[seat].viewer), onEnter,
  onAct(action, timing, pressedAt_ms) {
    actedAt_ms = performance.now();
    if (!state.player || state.mode === "watch") return;
    const { episode } = state.player.frame;
    const step = nextStep(line, state.player.frame);
    if (step !== null && links.send("player", act(episode, step, action, timing))) line = sent(line, { episode, step, sent: pressedAt_ms });
  },
});
startPulse({
  silence_ms: links.silence_ms, idle_ms: () => performance.now() - actedAt_ms, ask: api.health,
  onSuccess: () => state.link === "lost" && links.restart(),
  onFailure: () => { line = dropped(line); dispatch({ kind: "link", link: "lost" }); },
});
window.addEventListener("offline", () => dispatch({ kind: "link", link: "lost" }));
window.addEventListener("online", () => links.restart());
window.addEventListener("pointerdown", () => { actedAt_ms = performance.now(); });

for (const button of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("[data-mode]"))) {
  button.addEventListener("click", () => journey.start(/** @type {import("../common/game_state.js").Mode} */ (button.dataset.mode)));
}
by("open-sheet").addEventListener("click", sheet.open);
panels.player.part.next.addEventListener("click", goNext);
panels.player.part.again.addEventListener("click", () => state.player && journey.again(state.player.session, state.player.frame.episode));

for (const seat of SEATS) {
  panels[seat].part.pick.addEventListener("change", () => {
    sheet.choose(seat, /** @type {HTMLSelectElement} */ (panels[seat].part.pick).value);
    if (state.mode === "ranked") journey.replay(state, true);
    else journey.start(state.mode);
  });
  startPace(panels[seat].part.pace, (wish) => {
    const session = state[seat]?.session;
    if (session) api.setPace(session, wish).then((message) => dispatch({ kind: "received", seat, message }), (error) => dispatch({ kind: "notice", text: error.message }));
  });
}
for (const element of [...SEATS.map((seat) => panels[seat].part.matrix), by("chart").parentElement]) views.watch(element);

async function loadHumanLevel() {
  const answer = await api.humanLevel().catch(() => null);
  if (answer) paintHumanLevel(answer, state, document);
}
async function begin() {
  const isPadShown = localStorage.getItem("mars.pad") ?? String(matchMedia("(pointer: coarse), (max-width: 700px)").matches);
  document.body.dataset.pad = isPadShown;
  sheet.showPad(isPadShown === "true");
  try {
    const [levels, policies] = await Promise.all([api.levels(), api.policies()]);
    sheet.offer(levels, policies);
    for (const seat of SEATS) offerPolicies(panels[seat], policies.map(({ name }) => name));
  } catch (error) {
    dispatch({ kind: "notice", text: /** @type {Error} */ (error).message });
    dispatch({ kind: "link", link: "lost" });
    setTimeout(begin, 1000);
    return;
  }
  await journey.restore();
}
begin();
