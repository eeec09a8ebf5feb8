// @ts-check
// The daily page: today's board, one attempt, and what it came to. The only module of this page that knows all the others.
import { ApiError, createApi, createRequest, withTask } from "../common/api.js";
import { startBoards } from "../common/socket.js";
import { apply, initialState } from "../common/game_state.js";
import { create, createRepaint, elementsOf, put } from "../common/page.js";
import { loadTask } from "../common/task.js";
import { keepFocusOnBoard } from "../play/focus.js";
import { startInput } from "../play/input.js";
import { createBoard } from "./board.js";
import { createResults } from "./results.js";
import { countdown, dayText, streakText } from "./words.js";

const by = elementsOf(document);
const request = createRequest((path, options) => fetch(path, options), "");
const api = createApi((path, options) => fetch(path, options));
let state = initialState();
let actedAt_ms = performance.now();
/** @type {Daily.Today | null} */
let today = null;
Object.defineProperty(window, "mars", { value: Object.freeze({ get state() { return state; } }) });

const task = await loadTask(null);
const modules = await task.play?.();
const board = createBoard(document, { task, createViews: modules?.createViews, onChange: () => repaint(true), dismiss: (id) => dispatch({ kind: "dismiss", id }) });
const repaint = createRepaint(() => board.paint(state));
addEventListener("theme", () => repaint(true));
const results = createResults(document, { task, load: (day) => request(`daily/${day}/results`), onWrong: (text) => dispatch({ kind: "notice", text }) });

const { moves, telemetry } = startInput({
  page: window, task, board: board.root, settings: { repeat: by("repeat", HTMLSelectElement), sound: by("sound") }, pad: by("dock"), frames: [board.viewer],
  announce: (text) => { by("announcer").textContent = text; }, isPractice: () => false, isConnecting: () => state.link === "connecting", onEnter: () => false,
  onActivity: () => { actedAt_ms = performance.now(); }, send: (message) => connections.send("player", message), painted: board.painted,
  driven: () => (state.mode === "ranked" ? state.player?.frame ?? null : null),
});
const connections = startBoards({
  base: document.baseURI, moves, telemetry, dispatch, api, isLost: () => state.link === "lost", idle_ms: () => performance.now() - actedAt_ms,
  silence_ms: () => (state.mode === "spectator" ? 0 : connections.silence_ms()),
  async beforeRetry(_, session) {
    const about = await api.about(session);
    dispatch({ kind: "begun", about });
    return true;
  },
});
keepFocusOnBoard(document, { board: board.root, next: () => null });

/** Apply an event: the only place where the state changes.
 * @param {GameEvent} event */
function dispatch(event) {
  const before = state;
  state = apply(state, event);
  if (state === before) return;
  connections.sync(state.mode === "spectator" ? { ...state, player: null } : state);
  const frame = state.player?.frame;
  if (frame && frame !== before.player?.frame) {
    const said = task.announcement(before.player?.frame ?? null, frame);
    if (said) by("announcer").textContent = said;
    if (frame.outcome && today && (before.player?.frame.outcome ?? null) === null) ended(today);
  }
  repaint();
}

/** @param {Daily.Today} of */
function ended({ day }) {
  put(by("standing"), "That was your attempt for today. The next terrain comes at midnight UTC.");
  results.show(day);
}

/** Show the board of an attempt that had ended before this page was loaded.
 * @param {string} episode */
async function showEnded(episode) {
  const watched = await api.watched(episode);
  dispatch({ kind: "watched", watched: { ...watched, episode: "" }, name: "You" });
  dispatch({ kind: "link", link: "open" });
}

/** Count down to the next terrain, by the server's clock.
 * @param {Daily.Today} of */
function startCountdown({ now_ms, next_ms }) {
  const offset_ms = now_ms - Date.now();
  const tick = () => {
    const left_ms = next_ms - Date.now() - offset_ms;
    if (left_ms > 0) put(by("countdown"), `next terrain in ${countdown(left_ms)}`);
    else {
      clearInterval(timer);
      by("countdown").replaceChildren(create("a", "A new terrain is here", { href: "daily" }));
    }
  };
  const timer = setInterval(tick, 1000);
  tick();
}

async function begin() {
  try {
    today = /** @type {Daily.Today} */ (await request("daily"));
    put(by("day"), dayText(today.day));
    put(by("streak"), streakText(today.streak));
    put(by("commitment"), today.commitment);
    startCountdown(today);
    if (today.yesterday) results.showYesterday(today.yesterday).catch((error) => dispatch({ kind: "notice", text: error.message }));
    if (today.attempt?.state === "ended") await showEnded(today.attempt.episode);
    else dispatch({ kind: "begun", about: await withTask(request("daily", {})) });
  } catch (error) {
    if (!(error instanceof ApiError)) throw error;
    dispatch({ kind: "link", link: "lost" });
    if (error.status) dispatch({ kind: "notice", text: error.message });
    setTimeout(begin, 1500);
  }
}

document.body.dataset.pad = localStorage.getItem("mars.pad") ?? String(matchMedia("(pointer: coarse), (max-width: 700px)").matches);
begin();
