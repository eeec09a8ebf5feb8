// Wires everything: messages -> apply -> one scheduled repaint. The only module that knows all the others.
import { api, ApiError, request } from "../common/api.js";
import { startEndCard } from "../common/end_card.js";
import { apply, ghostOf, initialState, isDriven, isPractice } from "../common/game_state.js";
import { codesOf } from "../common/keyboard.js";
import { all, boardColours, by, chartColours, createRepaint, createSizes, createSlow, paintLink, paintNotices, put, SLOW_MS } from "../common/page.js";
import { startBoards } from "../common/socket.js";
import { browserStore, forgets, tabStore } from "../common/storage.js";
import { loadTask, paintAllowed, promptText, showTask } from "../common/task.js";
import { many, notCounted } from "../common/words.js";
import { askedIn, createEntries } from "./address.js";
import { keepFocusOnBoard } from "./focus.js";
import { startInput } from "./input.js";
import { createPanel, endOf, hasStage, hasTwoBoards, isFresh, offerPolicies, paintBar, paintPace, paintPanel, paintPick, paintWaits, startDialog, startPace, startTabs } from "./panels.js";
import { createLeaving, createSessions, findBoard, isUnfinished, modeOn, patiently, sessionWish, showInstead } from "./sessions.js";

const ROLES = /** @type {const} */ (["player", "rival"]);

let state = initialState();
/** Whether the task is known, and all is wired. */
let isReady = false;
/** Whether a move has been made on this page. */
let isPlayed = false;
Object.defineProperty(window, "playground", { value: Object.freeze({ get state() { return state; }, get latencies() { return [...latencies]; } }) });

const chart = by("chart");
/** @type {GameState | null} */
let painted = null;
/** @type {{pressed_ms: number}[]} answered moves that wait for their repaint */
let waiting = [];
/** @type {number[]} key press to repaint of the matrix, ms, the newest thousand */
const latencies = [];

/** How long to wait where what comes after the first frame could not be loaded. */
const RETRY_MS = 3000;
const VISITED = "humanplay.visited";
/** How many episodes were played to the end here: after three the legend is known (visit.js). */
const PLAYED = "humanplay.played";
/** The mark on the page's timeline at which the player's matrix was painted for the first time. */
const FIRST_FRAME = "humanplay.first-frame";
/** @type {Set<string>} */
const said = new Set();
/** @type {Hint | null} */
let hint = null;
let isCoaching = true;
const isFirstVisit = () => document.body.dataset.visit === "first";

const rootOf = (/** @type {string} */ role) => /** @type {HTMLElement} */ (document.querySelector(`[data-role=${role}]`));
const panels = { player: createPanel(rootOf("player")), rival: createPanel(rootOf("rival")) };
const { part } = panels.player;
const card = startEndCard();
/** How the episode that ended stands among the player's own. */
let own = { episode: "", text: "" };
const sizes = createSizes(() => {
  paintBoards(null); // in this very frame: both boards stand level in each that is shown
  repaint(true);
});
const announce = (/** @type {string} */ text) => { by("announcer").textContent = text; };
const dismiss = (/** @type {number} */ id) => dispatch({ kind: "dismiss", id });
const showTab = startTabs();
const repaint = createRepaint((isWhole) => {
  if (!isReady) return;
  if (isWhole) painted = null;
  paint();
  parts.costs?.paint();
});
addEventListener("theme", () => repaint(true));

/** Say what a board waits for on that board, so that it covers nothing to press, and the rest at the edge of the page. */
function paintAllNotices() {
  for (const role of ROLES) paintWaits(panels[role], state.notices);
  paintNotices(by("notices"), state.notices.filter(({ role }) => !role), dismiss);
}

/** @param {ApiError} error while nothing is known that could be shown */
function onFailure({ status, message }) {
  if (status !== 0) dispatch({ kind: "notice", text: message });
  dispatch({ kind: "link", link: "lost" });
  paintLink(by("link"), "lost", "live");
  paintAllNotices();
}

const entries = createEntries(window, {
  mustAsk: () => isUnfinished(state), ask: (leave) => leaving.ask(leave),
  show: (session) => sessions.goBack(session, () => {
    entries.clear();
    find().then((found) => { if (found) sessions.resume(found); }, (error) => dispatch({ kind: "notice", text: error.message }));
  }),
});
const find = () => findBoard({ api, hash: location.hash, entry: entries.session(), asked: askedIn(location.search), storage: tabStore,
  async start({ mode, wish: parts }) {
    const [known, offered] = await Promise.all([api.task(), api.policies()]);
    const first = (await loadTask(known)).firstWish(offered);
    return api.createSession(sessionWish(mode, first && { ...first, ...parts }));
  },
  watch: (id) => showInstead(id, api.watched, location),
  note: (text) => dispatch({ kind: "notice", text, tone: "note" }) });
const [found, served, levels, policies, maps] = await patiently(() => Promise.all([
  find(), api.task(), api.levels(), api.policies(), api.maps()]), onFailure);
if (found === undefined) await new Promise(() => {}); // the page is being left for somebody else's board
const task = found?.about?.task ?? await loadTask(served);
const viewsModule = await task.parts?.views();
showTask(task);

/** @type {Play.Parts} */
const parts = {
  views: viewsModule?.createViews({ panels: ROLES.map((role) => panels[role]), onChange: () => repaint(true) }) ?? null,
  costs: null, terrains: null, charts: null,
};
/** The board that began last.
 * @type {About | null} */
let begun = null;
const firstWish = task.firstWish(policies);
const wish = () => parts.terrains?.wish() ?? firstWish;
const sessions = createSessions({
  api, dispatch, wish, storage: tabStore,
  place: (session, query, hash) => entries.place(session, `${location.pathname}${query ?? location.search}${hash}`),
  onBegun(about) {
    if (about.task.name !== task.name) location.reload();
    begun = about;
    parts.terrains?.show(about);
  },
});
const leaving = createLeaving(by("leave-dialog", HTMLDialogElement), window, { state: () => state, start: sessions.start });
const { moves, telemetry, clock, keys } = startInput({
  task, onClock: () => (isDriven(state) ? state.player : null), board: panels.player.root, settings: { repeat: by("repeat", HTMLSelectElement), sound: by("sound"), dialog: by("display-dialog", HTMLDialogElement) }, announce,
  isPractice: () => isPractice(state), isHeld: (on) => state.link === "connecting" || sessions.isMadeAgain(on), pad: by("dock"),
  frames: ROLES.map((role) => panels[role].viewer), onEnter,
  send: (message) => connections.send("player", message), painted: () => painted?.player?.frame ?? null,
  driven: () => (isDriven(state) ? state.player?.frame ?? null : null),
});
const connections = startBoards({
  moves, telemetry, dispatch, isLost: () => state.link === "lost",
  onAnswered: (answered) => waiting.push(...answered),
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
  if (state === before || !isReady) return;
  if (event.kind === "begun") moves.drop("ended");
  followVisit(before, state);
  connections.sync(state);
  const frame = state.player?.frame;
  if (frame?.step && !isPlayed) loadPlayed();
  if (frame && frame !== before.player?.frame) {
    if (frame.episode !== before.player?.frame.episode) showTab("player");
    const said = task.announcement(before.player?.frame ?? null, frame);
    if (said) announce(said);
    if (state.mode === "ranked" && frame.outcome && wish()) sessions.replay(state);
    if (frame.outcome && !before.player?.frame.outcome) {
      if (state.mode !== "watch") browserStore.setItem(PLAYED, String((Number(browserStore.getItem(PLAYED)) || 0) + 1));
      sayOwn(frame.episode);
      countedEnded();
    }
  }
  repaint();
}

/** @param {GameState | null} before */
function paintBoards(before) {
  const dpr = window.devicePixelRatio || 1;
  const { you, policy } = boardColours(document.documentElement);
  const colours = { player: you, rival: policy };
  for (const role of ROLES) {
    const board = state[role];
    const { part } = panels[role];
    const trail = ghostOf(state, role);
    if (!board || (before && board === before[role] && trail === ghostOf(before, role))) continue;
    const isMine = role === "player";
    const shown = (isMine && parts.costs?.boardOf(board)) || board;
    const ghost = shown === board && trail ? { trail, accent: colours[isMine ? "rival" : "player"] } : null;
    task.paint(part.matrix, shown, { name: task.nameOf(board.name), accent: colours[role], ...sizes.of(part.matrix), dpr, has_range: true, follows: hasStage(panels[role]), ghost,
      marks: isMine ? parts.costs?.marks() : null });
  }
  const now_ms = performance.now();
  if (state.player && !performance.getEntriesByName(FIRST_FRAME).length) {
    performance.mark(FIRST_FRAME);
    setTimeout(loadRest); // once the frame is on the screen
  }
  latencies.push(...waiting.map((move) => now_ms - move.pressed_ms));
  latencies.splice(0, latencies.length - 1000);
  waiting = [];
}
/** @param {GameState | null} before */
function paintPanels(before) {
  const hasTwo = hasTwoBoards(state, isFirstVisit());
  for (const role of ROLES) {
    if (before && state[role] === before[role] && state.mode === before.mode) continue;
    const board = state[role];
    paintPanel(panels[role], task, (board && role === "player" && parts.costs?.boardOf(board)) || board);
    paintPick(panels[role], state[role]);
    paintPace(panels[role], state[role], role === "rival" && !state.rival?.isReplay);
    parts.views?.placeMap(panels[role], state[role]);
    parts.views?.load(panels[role], role === "player" || hasTwo ? state[role]?.session || null : null);
  }
}
/** Paint the curves after the boards' frame, which need not wait for them. */
const dueCurves = createSlow(paintCurves, task.clock ? SLOW_MS : 0);
function paintCurves() {
  if (!parts.charts) return;
  const { inks, font, you, policy, ground } = chartColours(document.documentElement);
  const colours = { player: you, rival: policy };
  const shown = hasTwoBoards(state, isFirstVisit()) ? ROLES : /** @type {const} */ (["player"]);
  const curves = shown.flatMap((role) => {
    const board = state[role];
    return board ? [{ board, colour: colours[role], isDashed: role === "rival" }] : [];
  });
  parts.charts.paintLegend(by("legend"), curves.map(({ board, colour, isDashed }) =>
    ({ name: task.nameOf(board.name), colour, dash: isDashed ? "9 4" : "" })));
  parts.charts.paintProgress(chart, task, curves, { font, inks, over: parts.costs?.overChart({ you, ground, ink: inks.goal }) });
  const label = curves.map(({ board: { name, progress } }) =>
    `${task.nameOf(name)}: ${task.chart.say(progress.at(-1) ?? 0)} after ${many(Math.max(0, progress.length - 1), "move")}`);
  chart.setAttribute("aria-label", label.join("; ") || `${task.chart.title} over moves`);
}

function paint() {
  const before = painted;
  painted = state;
  document.body.dataset.boards = hasTwoBoards(state, isFirstVisit()) ? "2" : "1";
  document.body.dataset.fresh = String(isFresh(state));
  paintBoards(before);
  paintPanels(before);
  parts.views?.paintCamera(state.player?.frame);
  if (state.player && isDriven(state)) paintAllowed(task, state.player.frame);
  clock.paint();
  paintVisit();
  paintBar(state, wish()?.rival ?? "");
  paintEnd();
  if (state.player !== before?.player || state.rival !== before?.rival) dueCurves(); // once the card has taken its room
  if (state.notices !== before?.notices) paintAllNotices();
}

function paintEnd() {
  const frame = state.player?.frame;
  const said = { tried: parts.costs?.triedText() ?? "", own: own.episode === frame?.episode ? own.text : "" };
  const hasJustEnded = card.show(frame, frame?.outcome ? endOf(frame, task, state, said) : {});
  if (!hasJustEnded) return;
  if (!document.querySelector("dialog[open]")) card.part.next.focus({ preventScroll: true });
  card.part.next.scrollIntoView({ block: "nearest" });
}

function paintVisit() {
  const { player, link } = state;
  const isFirst = isFirstVisit() && isDriven(state);
  const frame = player?.frame;
  part.prompt.hidden = task.clock !== null || !isFirst || !frame || frame.step > 0 || frame.outcome !== null || link === "lost";
  if (!part.prompt.hidden) put(part["prompt-text"], promptText(matchMedia("(pointer: coarse)").matches, task.keys, keys()));
  part.coach.hidden = !isFirst || !isCoaching || !hint || !frame || frame.step === 0;
  put(part["coach-gain"], hint?.gain ?? "");
  put(part["coach-line"], hint?.line ?? "");
}

/** Take note of a change of the player's board.
 * @param {GameState} before @param {GameState} after */
function followVisit(before, after) {
  const [was, is] = [before.player?.frame, after.player?.frame];
  if (!isFirstVisit() || !is || was === is || after.mode === "watch") return;
  if (is.step > 0) browserStore.setItem(VISITED, "yes");
  const isNext = was?.episode === is.episode && is.step > was.step && !is.outcome;
  hint = (isNext && task.hint(was, is, said)) || null;
  if (hint?.id) said.add(hint.id);
  if (!is.outcome || was?.episode !== is.episode) return;
  document.body.dataset.visit = "again";
  repaint(true);
}

/** Say after the end of an episode that was to count when it does not. */
async function countedEnded() {
  const { mode, counts, player } = state;
  const about = mode === "ranked" && counts && player ? await api.about(player.session).catch(() => null) : null;
  if (about?.not_attested) {
    dispatch({ kind: "begun", about });
    dispatch({ kind: "notice", text: notCounted(about.not_attested, about.attestation), tone: "note" });
  }
}

/** Say on the end card how the player's episode stands among their own, and what a ranked one is worth among people.
 * @param {string} episode */
async function sayOwn(episode) {
  const { mode, counts } = state;
  if (mode === "watch") return;
  const asked = /** @type {Promise<Answers.People | null>} */ (mode === "ranked" && counts && task.has_boards ? request("people?period=all").catch(() => null) : null);
  const [words, history, people] = await Promise.all([import("../me/words.js"), api.history(), asked]).catch(() => []);
  const texts = words && history ? [people ? words.rankedText(task, history, episode, people) : "", words.personalText(task, history, episode)] : [];
  own = { episode, text: texts.filter(Boolean).join(" ") };
  repaint();
}

/** Load what the first frame does without, once more where the connection was lost.
 * @template T @param {() => Promise<T>} load @returns {Promise<T>} */
async function loadLater(load) {
  try {
    return await load();
  } catch {
    await new Promise((done) => { setTimeout(done, RETRY_MS); });
    return loadLater(load);
  }
}

async function loadCharts() {
  parts.charts = await loadLater(() => import("../common/chart.js"));
  repaint(true);
}

let isDailyAsked = false;
/** Show how today's terrain stands; a first visit has its own to begin with. */
async function showDaily() {
  if (isDailyAsked) return;
  isDailyAsked = true;
  const asked = /** @type {Promise<Answers.Today>} */ (request("daily"));
  const [words, today] = await Promise.all([import("../daily/words.js"), asked]).catch(() => []);
  if (!words || !today) return;
  put(/** @type {HTMLElement} */ (by("daily-pill").querySelector("span")), words.pillText(task, today));
  by("daily-pill").hidden = false;
}

async function loadRest() {
  if (!isFirstVisit() && task.has_boards) showDaily();
  if (!isFirstVisit()) loadCharts(); // before its first move a first visit shows none
  if (task.parts) {
    const { createTerrainDialog } = await loadLater(task.parts.terrains);
    parts.terrains = createTerrainDialog(startDialog("terrain"), {
      onStart: (wish) => setTimeout(() => leaving.start(modeOn(state.mode, wish), wish)), // once the dialog is closed
      onWrong: (text) => dispatch({ kind: "notice", text }),
    });
    parts.terrains.offer(levels, policies, maps);
    if (begun) parts.terrains.show(begun);
  }
}

/** Load what stands on a board that has been moved on. */
async function loadPlayed() {
  isPlayed = true;
  if (!parts.charts) loadCharts();
  if (!task.parts) return;
  const { createCosts } = await loadLater(task.parts.costs);
  parts.costs = createCosts({ part: card.part, canvas: panels.player.canvas, chart, state: () => state, load: api.costs,
    storage: tabStore, onChange: () => repaint(true),
    tryFrom(moves) {
      const { mode, player } = state;
      if (player) sessions.tryFrom({ episode: player.frame.episode, moves }, mode === "practice" ? player.session : null);
    } });
  repaint(true);
}

function goNext() {
  // practice goes on as practice: alone on this board, the next terrain would be a ranked one
  if (isPractice(state) && !state.rival?.session) sessions.start("practice");
  else if (state.player) sessions.next(state.player.session, null);
}
/** Go to the next terrain with Enter once the episode is over, unless Enter belongs to another button. */
function onEnter() {
  const focused = document.activeElement;
  if (!state.player?.frame.outcome || (focused?.matches("button, a, summary") && focused !== card.part.next)) return false;
  goNext();
  return true;
}
/** @param {typeof found} board that is gone on with */
const restore = (board) => { if (board) sessions.resume(board); };

for (const button of all("button[data-mode]")) button.addEventListener("click", () => leaving.start(/** @type {Mode} */ (button.dataset.mode), wish()));
startDialog("display");
const help = startDialog("help");
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.repeat || document.querySelector("dialog[open]")) return;
  if (/** @type {Element} */ (event.target).closest("input, select, textarea")) return;
  const isAgain = codesOf(event)[0] === "KeyR" && !event.shiftKey && state.player?.frame.outcome && !card.part.again.hidden;
  if (event.key !== "?" && !isAgain) return;
  event.preventDefault();
  if (isAgain) card.part.again.click();
  else help.showModal();
});
const pad = /** @type {HTMLInputElement} */ (document.querySelector("#display-dialog [name=pad]"));
pad.checked = document.body.dataset.pad === "true";
pad.addEventListener("change", () => {
  browserStore.setItem("humanplay.pad", String(pad.checked));
  document.body.dataset.pad = String(pad.checked);
});
keepFocusOnBoard({ board: panels.player.root, next: () => (state.player?.frame.outcome ? card.part.next : null) });
card.part.next.addEventListener("click", goNext);
card.part.again.addEventListener("click", () => {
  if (state.challenges) sessions.challenge(state.challenges);
  else if (state.player) sessions.again(state.player.session, state.player.frame.episode);
});
for (const role of ROLES) {
  offerPolicies(panels[role], task, policies.map(({ name }) => name));
  panels[role].part.pick.addEventListener("change", () => {
    const { value } = /** @type {HTMLSelectElement} */ (panels[role].part.pick);
    parts.terrains?.choose(role, value);
    if (firstWish) firstWish[role] = value;
    if (state.mode === "ranked") sessions.replay(state, true);
    else leaving.start(state.mode, wish());
  });
  startPace(panels[role].part.pace, (pace) => {
    const session = state[role]?.session;
    if (session) api.setPace(session, pace).then((message) => dispatch({ kind: "received", role, message }), (error) => dispatch({ kind: "notice", text: error.message }));
  });
  sizes.watch(panels[role].part.matrix);
}
sizes.watch(chart);
part["coach-close"].addEventListener("click", () => {
  isCoaching = false;
  part.coach.hidden = true;
});
isReady = true;
if (forgets()) dispatch({ kind: "notice", text: forgets(), tone: "note" });
restore(found);
