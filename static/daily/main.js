// @ts-check
// The daily page: today's board, one attempt, and what it came to. The only module of this page that knows all the others.
import { ApiError, createApi, createRequest } from "../common/api.js";
import { createConnections } from "../common/socket.js";
import { apply, initialState } from "../common/game_state.js";
import { startHeartbeat } from "../common/heartbeat.js";
import { createRepaint, elementsOf, put } from "../common/page.js";
import { keepFocusOnBoard } from "../play/focus.js";
import { startInput } from "../play/input.js";
import { announcement } from "../play/words.js";
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

const board = createBoard(document, { onChange: () => repaint(true), dismiss: (id) => dispatch({ kind: "dismiss", id }) });
const repaint = createRepaint(() => board.paint(state));
addEventListener("theme", () => repaint(true));
const results = createResults(document, { load: (day) => request(`daily/${day}/results`), onWrong: (text) => dispatch({ kind: "notice", text }) });

const connections = createConnections({
  base: document.baseURI,
  onMessage(role, message) {
    if (role === "player") moves.receive(message);
    if (message.kind === "kept") telemetry.answered(message);
    else dispatch({ kind: "received", role, message });
  },
  onLink(_, link) {
    if (link === "lost") moves.drop();
    if (link === "open") telemetry.reconnected();
    dispatch({ kind: "link", link });
  },
  async beforeRetry(_, session) {
    const about = await api.about(session);
    dispatch({ kind: "begun", about });
    return true;
  },
});
const { moves, telemetry } = startInput({
  page: window, board: board.root, settings: { repeat: by("repeat", HTMLSelectElement), sound: by("sound") }, pad: by("dock"), frames: [board.viewer],
  announce: (text) => { by("announcer").textContent = text; }, isPractice: () => false, isConnecting: () => state.link === "connecting", onEnter: () => false,
  onActivity: () => { actedAt_ms = performance.now(); }, send: (message) => connections.send("player", message), painted: board.painted,
  driven: () => (state.mode === "ranked" ? state.player?.frame ?? null : null),
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
    const said = announcement(before.player?.frame ?? null, frame);
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
  const { level, size, frame, history } = await api.watched(episode);
  /** @type {Board} */
  const shown = { session: "", name: "You", frame, trail: history.positions, discovered: history.discovered, hasGap: false, pace: null, isReplay: false };
  dispatch({ kind: "watched", level, size, board: shown });
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
      const link = document.createElement("a");
      link.href = "daily";
      link.textContent = "A new terrain is here";
      by("countdown").replaceChildren(link);
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
    else dispatch({ kind: "begun", about: await request("daily", {}) });
  } catch (error) {
    if (!(error instanceof ApiError)) throw error;
    dispatch({ kind: "link", link: "lost" });
    if (error.status) dispatch({ kind: "notice", text: error.message });
    setTimeout(begin, 1500);
  }
}

startHeartbeat({
  silence_ms: () => (state.mode === "spectator" ? 0 : connections.silence_ms()), idle_ms: () => performance.now() - actedAt_ms, ask: api.health,
  onSuccess: () => { if (state.link === "lost") connections.check(); },
  onFailure: () => { moves.drop(); dispatch({ kind: "link", link: "lost" }); },
});
addEventListener("offline", () => dispatch({ kind: "link", link: "lost" }));
addEventListener("online", () => connections.restart());
document.body.dataset.pad = localStorage.getItem("mars.pad") ?? String(matchMedia("(pointer: coarse), (max-width: 700px)").matches);
begin();
