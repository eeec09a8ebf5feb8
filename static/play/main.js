// @ts-check
// Wires everything: messages -> apply -> one scheduled repaint. The only module that knows all the others.
import { ApiError, createApi } from "../common/api.js";
import { createConnections } from "../common/socket.js";
import { apply, initialState } from "../common/game_state.js";
import { startHeartbeat } from "../common/heartbeat.js";
import { copyOnClick, createRepaint, elementsOf } from "../common/page.js";
import { createVolunteers, startHelp, startTabs } from "./bar.js";
import { createFirstVisit } from "./first_visit.js";
import { keepFocusOnBoard } from "./focus.js";
import { startInput } from "./input.js";
import { createLeaving, showInstead } from "./leaving.js";
import { createLosses } from "./losses.js";
import { createPanel, offerPolicies, startPace } from "./panels.js";
import { createPainter } from "./painter.js";
import { createSessions } from "./sessions.js";
import { createThinking } from "./thinking.js";
import { createTerrainDialog } from "./terrain_dialog.js";
import { createViews } from "./views.js";
import { announcement } from "./words.js";

const by = elementsOf(document);
const ROLES = /** @type {const} */ (["player", "rival"]);

let state = initialState();
let actedAt_ms = performance.now();
Object.defineProperty(window, "mars", { value: Object.freeze({ get state() { return state; }, get latencies() { return painter.latencies(); } }) });

const template = by("board-template", HTMLTemplateElement);
const rootOf = (/** @type {string} */ role) => /** @type {HTMLElement} */ (document.querySelector(`[data-role=${role}]`));
const panels = { player: createPanel(rootOf("player"), template, [by("end-card")]), rival: createPanel(rootOf("rival"), template) };
const api = createApi((path, options) => fetch(path, options));
const views = createViews({ page: document, panels: ROLES.map((role) => panels[role]), storage: localStorage, onChange: () => repaint(true) });

addEventListener("theme", () => repaint(true));
const thinking = createThinking({ page: document, storage: localStorage, send: (role, message) => connections.send(role, message), onChange: () => repaint(true) });

const visit = createFirstVisit({ page: document, part: panels.player.part, storage: localStorage, isTouch: matchMedia("(pointer: coarse)").matches,
  onEnded: () => repaint(true) });
const painter = createPainter({ page: document, panels, views, visit, rivalName: () => terrainDialog.wish().rival, paysBonus: (level) => terrainDialog.paysBonus(level),
  thinking, losses: () => losses, dismiss: (id) => dispatch({ kind: "dismiss", id }) });
const showTab = startTabs(document);
const volunteers = createVolunteers({ page: document, api, state: () => state, dispatch });
const repaint = createRepaint((isWhole) => {
  if (isWhole) painter.forget();
  painter.paint(state);
  losses.paint();
});

const terrainDialog = createTerrainDialog(by("terrain-dialog", HTMLDialogElement), {
  onStart: (wish) => setTimeout(() => leaving.start(state.mode, wish)), // once the dialog is closed
  onWrong: (text) => dispatch({ kind: "notice", text }),
  onPad: (isShown) => { localStorage.setItem("mars.pad", String(isShown)); document.body.dataset.pad = String(isShown); },
});
const sessions = createSessions({
  api, dispatch, wish: terrainDialog.wish, hash: () => location.hash, storage: sessionStorage,
  setHash: (hash) => history.replaceState(null, "", hash),
  watch: (id) => showInstead(id, api.watched, location),
  onBegun(about) {
    terrainDialog.show(about);
    terrainDialog.forgetSeed();
    volunteers.load();
  },
});
const losses = createLosses({ page: document, part: panels.player.part, canvas: panels.player.canvas, chart: by("chart"),
  state: () => state, load: api.regret, tryFrom: sessions.tryFrom, onChange: () => repaint(true) });
const leaving = createLeaving(by("leave-dialog", HTMLDialogElement), window, { state: () => state, start: sessions.start });
const connections = createConnections({
  base: document.baseURI,
  onMessage(role, message) {
    if (role === "player") painter.answered(moves.receive(message));
    if (message.kind === "kept") telemetry.answered(message);
    else dispatch({ kind: "received", role, message });
  },
  onLink(role, link) {
    if (link === "lost") moves.drop();
    if (role !== "player") return;
    if (link === "open") telemetry.reconnected();
    dispatch({ kind: "link", link });
  },
  async beforeRetry(role, session) {
    try {
      const about = await api.about(session);
      if (role === "player") dispatch({ kind: "begun", about });
      return true;
    } catch (error) {
      if (!(error instanceof ApiError) || error.status !== 404) throw error;
      if (role === "player") sessions.restore();
      return false;
    }
  },
});
const { moves, telemetry } = startInput({
  page: window, board: panels.player.root, settings: { repeat: by("repeat", HTMLSelectElement), sound: by("sound") },
  announce: (text) => { by("announcer").textContent = text; }, isPractice: () => state.mode === "practice", isConnecting: () => state.link === "connecting", pad: by("dock"), frames: ROLES.map((role) => panels[role].viewer), onEnter, onActivity: () => { actedAt_ms = performance.now(); },
  send: (message) => connections.send("player", message), painted: painter.playersFrame,
  driven: () => (state.mode === "practice" || state.mode === "ranked" ? state.player?.frame ?? null : null),
});

/** Apply an event: the only place where the state changes.
 * @param {GameEvent} event */
function dispatch(event) {
  const before = state;
  state = apply(state, event);
  if (state === before) return;
  if (event.kind === "begun") moves.drop("ended");
  visit.follow(before, state);
  connections.sync(state);
  const frame = state.player?.frame;
  if (frame && frame !== before.player?.frame) {
    if (frame.episode !== before.player?.frame.episode) showTab("player");
    const said = announcement(before.player?.frame ?? null, frame);
    if (said) by("announcer").textContent = said;
    if (state.mode === "ranked" && frame.outcome) sessions.replay(state);
    if (frame.outcome && !before.player?.frame.outcome) volunteers.ended();
  }
  repaint();
}

const goNext = () => { if (state.player) sessions.next(state.player.session, null); };
/** Go to the next terrain with Enter once the episode is over, unless Enter belongs to another button. */
function onEnter() {
  const focused = document.activeElement;
  if (!state.player?.frame.outcome || (focused?.matches("button, a") && focused !== panels.player.part.next)) return false;
  goNext();
  return true;
}

startHeartbeat({
  silence_ms: () => connections.silence_ms(), idle_ms: () => performance.now() - actedAt_ms, ask: api.health,
  onSuccess: () => { if (state.link === "lost") connections.check(); },
  onFailure: () => { moves.drop(); dispatch({ kind: "link", link: "lost" }); },
});
window.addEventListener("offline", () => dispatch({ kind: "link", link: "lost" }));
window.addEventListener("online", connections.restart);
window.addEventListener("hashchange", () => location.reload()); // a link pasted over another

for (const button of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("button[data-mode]"))) {
  button.addEventListener("click", () => leaving.start(/** @type {Mode} */ (button.dataset.mode), terrainDialog.wish()));
}
by("open-terrain-dialog").addEventListener("click", terrainDialog.open);
startHelp(document);
keepFocusOnBoard(document, { board: panels.player.root, next: () => (state.player?.frame.outcome ? panels.player.part.next : null) });
panels.player.part.next.addEventListener("click", goNext);
copyOnClick(panels.player.part["copy-replay"],
  () => /** @type {HTMLAnchorElement} */ (panels.player.part["replay-link"]).href,
  (text) => { by("announcer").textContent = text; });
panels.player.part.again.addEventListener("click", () => { if (state.player) sessions.again(state.player.session, state.player.frame.episode); });

for (const role of ROLES) {
  panels[role].part.pick.addEventListener("change", () => {
    terrainDialog.choose(role, /** @type {HTMLSelectElement} */ (panels[role].part.pick).value);
    if (state.mode === "ranked") sessions.replay(state, true);
    else sessions.start(state.mode);
  });
  startPace(panels[role].part.pace, (wish) => {
    const session = state[role]?.session;
    if (session) api.setPace(session, wish).then((message) => dispatch({ kind: "received", role, message }), (error) => dispatch({ kind: "notice", text: error.message }));
  });
  views.watch(panels[role].part.matrix);
}
views.watch(by("chart"));
views.watch(by("values"));

async function begin() {
  terrainDialog.showPad(document.body.dataset.pad === "true");
  try {
    const [levels, policies, maps] = await Promise.all([api.levels(), api.policies(), api.maps()]);
    terrainDialog.offer(levels, policies, maps);
    for (const role of ROLES) offerPolicies(panels[role], policies.map(({ name }) => name));
  } catch (error) {
    dispatch({ kind: "notice", text: /** @type {Error} */ (error).message });
    dispatch({ kind: "link", link: "lost" });
    setTimeout(begin, 1000);
    return;
  }
  await sessions.restore();
}
begin();
