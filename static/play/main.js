// Wires everything: messages -> apply -> one scheduled repaint. The only module that knows all the others.
import { api, ApiError } from "../common/api.js";
import { startBoards } from "../common/socket.js";
import { apply, initialState } from "../common/game_state.js";
import { copyOnClick, createRepaint, createSizes, by, paintLink, paintNotices } from "../common/page.js";
import { loadTask, showTask } from "../common/task.js";
import { createPanel, createVolunteers, offerPolicies, startDialog, startPace, startTabs } from "./panels.js";
import { createFirstVisit } from "./first_visit.js";
import { keepFocusOnBoard } from "./focus.js";
import { startInput } from "./input.js";
import { createLeaving, createSessions, findBoard, patiently, showInstead, taskInSearch } from "./sessions.js";
import { createPainter } from "./painter.js";

const ROLES = /** @type {const} */ (["player", "rival"]);

let state = initialState();
let actedAt_ms = performance.now();
/** @type {ReturnType<typeof createPainter> | null} null before the task is known */
let painter = null;
Object.defineProperty(window, "mars", { value: Object.freeze({ get state() { return state; }, get latencies() { return painter?.latencies() ?? []; } }) });

const template = by("board-template", HTMLTemplateElement);
const rootOf = (/** @type {string} */ role) => /** @type {HTMLElement} */ (document.querySelector(`[data-role=${role}]`));
const panels = { player: createPanel(rootOf("player"), template, [by("end-card")]), rival: createPanel(rootOf("rival"), template) };
const { part } = panels.player;
const sizes = createSizes(() => repaint(true));
const announce = (/** @type {string} */ text) => { by("announcer").textContent = text; };
const dismiss = (/** @type {number} */ id) => dispatch({ kind: "dismiss", id });
const showTab = startTabs();
const repaint = createRepaint((isWhole) => {
  if (isWhole) painter?.forget();
  painter?.paint(state);
  parts.losses?.paint();
});
addEventListener("theme", () => repaint(true));

/** @param {ApiError} error while nothing is known that could be shown */
function onFailure({ status, message }) {
  if (status !== 0) dispatch({ kind: "notice", text: message });
  dispatch({ kind: "link", link: "lost" });
  paintLink(by("link"), "lost", "live");
  paintNotices(by("notices"), state.notices, dismiss);
}

const find = () => findBoard({ api, hash: location.hash, storage: sessionStorage, watch: (id) => showInstead(id, api.watched, location),
  note: (text) => dispatch({ kind: "notice", text, tone: "note" }) });
const asked = taskInSearch(location.search);
const [found, levels, policies, maps] = await patiently(() => Promise.all([
  asked ? api.createSession({ task: asked, player: "human" }).then((about) => ({ about, isNewest: false })) : find(), api.levels(), api.policies(), api.maps()]), onFailure);
if (found === undefined) await new Promise(() => {}); // the page is being left for somebody else's board
const task = found?.about?.task ?? await loadTask(null);
const modules = await task.play?.();
showTask(task);

/** @type {Play.Parts} */
const parts = {
  views: modules?.createViews({ panels: ROLES.map((role) => panels[role]), onChange: () => repaint(true) }) ?? null,
  thinking: modules?.createThinking({ send: (role, message) => connections.send(role, message), onChange: () => repaint(true) }) ?? null,
  losses: modules?.createLosses({ part, canvas: panels.player.canvas, chart: by("chart"), state: () => state, load: api.regret,
    tryFrom: (on, step) => sessions.tryFrom(on, step), onChange: () => repaint(true) }) ?? null,
};
const terrainDialog = modules?.createTerrainDialog(by("terrain-dialog", HTMLDialogElement), {
  onStart: (wish) => setTimeout(() => leaving.start(state.mode, wish)), // once the dialog is closed
  onWrong: (text) => dispatch({ kind: "notice", text }),
});
const wish = () => terrainDialog?.wish() ?? { level: "", map: null, size: 0, seed: null, rival: "", player: "human", task: task.name };
const visit = createFirstVisit({ part, isTouch: matchMedia("(pointer: coarse)").matches, onEnded: () => repaint(true) });
painter = createPainter({ task, panels, sizes, visit, parts, dismiss, rivalName: () => wish().rival, paysBonus: (level) => terrainDialog?.paysBonus(level) ?? false });
const volunteers = createVolunteers({ state: () => state, dispatch });
const sessions = createSessions({
  api, dispatch, wish, storage: sessionStorage, setHash: (hash) => history.replaceState(null, "", hash),
  onBegun(about) {
    if (about.task.name !== task.name) location.reload();
    terrainDialog?.show(about);
    volunteers.load();
  },
});
const leaving = createLeaving(by("leave-dialog", HTMLDialogElement), window, { state: () => state, start: sessions.start });
const { moves, telemetry } = startInput({
  page: window, task, board: panels.player.root, settings: { repeat: by("repeat", HTMLSelectElement), sound: by("sound") }, announce,
  isPractice: () => state.mode === "practice", isConnecting: () => state.link === "connecting", pad: by("dock"),
  frames: ROLES.map((role) => panels[role].viewer), onEnter, onActivity: () => { actedAt_ms = performance.now(); },
  send: (message) => connections.send("player", message), painted: () => painter?.playersFrame() ?? null,
  driven: () => (state.mode === "practice" || state.mode === "ranked" ? state.player?.frame ?? null : null),
});
const connections = startBoards({
  moves, telemetry, dispatch, isLost: () => state.link === "lost", idle_ms: () => performance.now() - actedAt_ms,
  onAnswered: (answered) => painter?.answered(answered),
  async beforeRetry(role, session) {
    try {
      const about = await api.about(session);
      if (role === "player") dispatch({ kind: "begun", about });
      return true;
    } catch (error) {
      if (!(error instanceof ApiError) || error.status !== 404) throw error;
      if (role === "player") restore(await patiently(find, onFailure));
      return false;
    }
  },
});

/** Apply an event: the only place where the state changes.
 * @param {GameEvent} event */
function dispatch(event) {
  const before = state;
  state = apply(state, event);
  if (state === before || !painter) return;
  if (event.kind === "begun") moves.drop("ended");
  visit.follow(before, state);
  connections.sync(state);
  const frame = state.player?.frame;
  if (frame && frame !== before.player?.frame) {
    if (frame.episode !== before.player?.frame.episode) showTab("player");
    const said = task.announcement(before.player?.frame ?? null, frame);
    if (said) announce(said);
    if (state.mode === "ranked" && frame.outcome && modules) sessions.replay(state);
    if (frame.outcome && !before.player?.frame.outcome) volunteers.ended();
  }
  repaint();
}

const goNext = () => { if (state.player) sessions.next(state.player.session, null); };
/** Go to the next terrain with Enter once the episode is over, unless Enter belongs to another button. */
function onEnter() {
  const focused = document.activeElement;
  if (!state.player?.frame.outcome || (focused?.matches("button, a") && focused !== part.next)) return false;
  goNext();
  return true;
}
/** @param {typeof found} board that is gone on with */
const restore = (board) => { if (board) sessions.resume(board); };

window.addEventListener("hashchange", () => location.reload()); // a link pasted over another
for (const button of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("button[data-mode]"))) {
  button.addEventListener("click", () => leaving.start(/** @type {Mode} */ (button.dataset.mode), wish()));
}
startDialog("terrain");
const help = startDialog("help");
document.addEventListener("keydown", (event) => {
  if (event.key !== "?" || event.ctrlKey || event.metaKey || document.querySelector("dialog[open]")) return;
  if (/** @type {Element} */ (event.target).closest("input, select, textarea")) return;
  event.preventDefault();
  help.showModal();
});
const pad = /** @type {HTMLInputElement} */ (document.querySelector("#wish [name=pad]"));
pad.checked = document.body.dataset.pad === "true";
pad.addEventListener("change", () => {
  localStorage.setItem("mars.pad", String(pad.checked));
  document.body.dataset.pad = String(pad.checked);
});
keepFocusOnBoard({ board: panels.player.root, next: () => (state.player?.frame.outcome ? part.next : null) });
part.next.addEventListener("click", goNext);
copyOnClick(part["copy-replay"], () => /** @type {HTMLAnchorElement} */ (part["replay-link"]).href, announce);
part.again.addEventListener("click", () => { if (state.player) sessions.again(state.player.session, state.player.frame.episode); });
for (const role of ROLES) {
  offerPolicies(panels[role], policies.map(({ name }) => name));
  panels[role].part.pick.addEventListener("change", () => {
    terrainDialog?.choose(role, /** @type {HTMLSelectElement} */ (panels[role].part.pick).value);
    if (state.mode === "ranked") sessions.replay(state, true);
    else sessions.start(state.mode);
  });
  startPace(panels[role].part.pace, (pace) => {
    const session = state[role]?.session;
    if (session) api.setPace(session, pace).then((message) => dispatch({ kind: "received", role, message }), (error) => dispatch({ kind: "notice", text: error.message }));
  });
  sizes.watch(panels[role].part.matrix);
}
for (const chart of ["chart", "values"]) sizes.watch(by(chart));
terrainDialog?.offer(levels, policies, maps);
restore(found);
