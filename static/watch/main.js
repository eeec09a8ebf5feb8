// Wires the live view of somebody else's board: its socket -> state -> one scheduled repaint. Nothing here sends anything.
import { api, ApiError, request } from "../common/api.js";
import { paintProgress } from "../common/chart.js";
import { boardColours, by, chartColours, copyOnClick, createRepaint, createSizes, createSlow, paintLink, partsOf, put, SLOW_MS } from "../common/page.js";
import { follow, socketUrl, startHeartbeat } from "../common/socket.js";
import { apply, initialState } from "../common/game_state.js";
import { lengthOf, paintNumbers } from "../common/task.js";
import { endedLine, idInPath, liveHeadline, watchedName } from "./words.js";

const id = idInPath(location.pathname) ?? "";
const part = partsOf(document);
const chart = by("chart");

let state = initialState();
/** The newest question of `load`: an answer to an earlier one changes nothing. */
let asked = 0;
Object.defineProperty(window, "playground", { value: Object.freeze({ get state() { return state; } }) });
const repaint = createRepaint(() => paint());
const sizes = createSizes(() => repaint());
const [paintCurveSlowly, paintCurveAfterFrame] = [SLOW_MS, 0].map((wait_ms) => createSlow(paintCurve, wait_ms));
/** @type {ReturnType<typeof follow> | null} */
let follower = null;

/** @param {GameEvent} event */
function dispatch(event) {
  const before = state;
  state = apply(state, event);
  if (state === before) return;
  const [was, is] = [before.player?.frame ?? null, state.player?.frame ?? null];
  const said = is && was && state.task?.announcement(was, is);
  if (said) put(by("announcer"), said);
  repaint();
}

function paint() {
  paintLink(by("link"), state.link, state.player?.frame.outcome ? "ended" : "connected");
  const { player: board, task } = state;
  if (!board || !task) return;
  const { frame, name } = board;
  const said = task.nameOf(name);
  task.paint(part.ground, board, { name: said, accent: boardColours(part.ground).you, ...sizes.of(part.ground), dpr: window.devicePixelRatio || 1, follows: true });
  put(by("name"), said);
  put(part["chart-title"], task.chart.title);
  put(by("terrain"), task.place(state.level, frame));
  const { value, unit } = paintNumbers(part, task, frame);
  (task.clock ? paintCurveSlowly : paintCurveAfterFrame)(task, board);
  chart.setAttribute("aria-label", `${said}: ${value} ${unit} after ${lengthOf(task, frame.step)} ${task.clock ? "seconds" : "moves"}`);
}
/** @param {Task} task @param {Board} board */
function paintCurve(task, board) {
  const { you, font, inks } = chartColours(chart);
  paintProgress(chart, task, [{ board, colour: you }], { font, inks });
}

/** @param {string} player */
function showLive(player) {
  put(by("badge"), "live");
  put(by("watching-text"), liveHeadline(state.task?.nameOf(player) ?? player));
  put(by("watching-line"), "You see each move as it is made. Your keys move nothing here.");
  put(part.outcome, "");
  delete part.outcome.dataset.outcome;
  by("ended").hidden = true;
}

/** Say how an episode ended, and offer its replay where there is one for whoever asks.
 * @param {Watched} watched */
async function showEnd({ episode, player }) {
  put(by("badge"), "ended");
  put(by("watching-text"), "This episode has ended");
  put(by("watching-line"), endedLine(player, state.task?.round ?? "episode", episode !== id));
  const replay = /** @type {ReplayData | null} */ (await request(`episodes/${episode}/replay`).catch(() => null));
  if (!replay || state.player?.frame.episode !== episode) return;
  put(by("watching-text"), `${state.task?.nameOf(replay.run.name)} ${replay.run.sentence}`);
  put(part.outcome, replay.run.sentence);
  part.outcome.dataset.outcome = replay.run.outcome ?? "";
  by("watch-replay", HTMLAnchorElement).href = `../replay/${episode}`;
  by("ended").hidden = false;
}

/** Ask for the episode as it stands; return whether more will come: a board's next episode does, after one that was linked nothing. */
async function load() {
  const mine = ++asked;
  const watched = await api.watched(id);
  if (mine !== asked) return true;
  dispatch({ kind: "watched", watched, name: watchedName(watched.player) });
  if (!watched.frames) showLive(watched.player);
  else await showEnd(watched);
  if (!watched.frames || watched.episode !== id) return true;
  follower?.close();
  dispatch({ kind: "link", link: "open" }); // the server closed the socket at the end
  return false;
}

async function begin() {
  try {
    if (!(await load())) return;
  } catch (error) {
    dispatch({ kind: "link", link: "lost" });
    if (error instanceof ApiError && error.status === 404) put(by("watching-text"), error.message);
    else setTimeout(begin, 1000);
    return;
  }
  follower = follow({ url: socketUrl(id, "ws/watch"), beforeRetry: load, onLink: (link) => dispatch({ kind: "link", link }),
    onMessage(message) {
      const before = state.player?.frame.episode;
      dispatch({ kind: "received", role: "player", message });
      if (message.kind === "frame" && (message.outcome || message.episode !== before)) load().catch(() => follower?.restart());
    } });
}

copyOnClick(by("copy-link"), () => location.href, (text) => put(by("announcer"), text));
startHeartbeat({ waited_ms: () => (state.link === "lost" ? Infinity : 0),
  onSuccess: () => { if (state.link === "lost") follower?.restart(); }, onFailure: () => dispatch({ kind: "link", link: "lost" }) });
for (const what of ["theme", "resize"]) window.addEventListener(what, () => repaint());
sizes.watch(part.ground);
begin();
