// The whole state of the page in one object. `apply` returns the next state and changes nothing that it was given.
import { spoken } from "./texts.js";

/** @returns {GameState} */
export function initialState() {
  return { mode: "practice", level: "random", size: 21, counts: false, player: null, rival: null, link: "connecting", task: null,
    notices: [], nextNotice: 1, challenges: null, opponent: null };
}

/** Return whether a person drives the player's board from here.
 * @param {GameState} state */
export const isDriven = ({ mode }) => mode !== "watch" && mode !== "spectator";

/** Return whether nothing counts, so that keys may repeat and a terrain be played again.
 * @param {GameState} state */
export const isPractice = ({ mode }) => mode === "practice" || mode === "challenge";

/** @param {Task} task @param {string} session @param {string} name @param {Frame} frame @param {Board | null} before
 * @returns {Board} */
export function boardOf(task, session, name, frame, before) {
  if (before && before.session === session) return { ...withFrame(task, before, frame), name };
  return withFrame(task, { session, name, frame, trail: [], progress: [], hasGap: false, pace: null, isReplay: false }, frame);
}

/** Return the board after `frame`: the newest wins, an older one of the same episode changes nothing.
 * @param {Task} task @param {Board} board @param {Frame} frame @returns {Board} */
export function withFrame(task, board, frame) {
  const isNew = frame.episode !== board.frame.episode;
  if (board.remade) board = { ...board, remade: null };
  if (!isNew && frame.step < board.frame.step) return board;
  if (isNew) board = { ...board, clock: null, trail: [], progress: [] };
  const { trail, progress } = board;
  if (frame.step < trail.length) return { ...board, frame };
  if (task.clock && trail.length) { // frames that were skipped are nothing to ask for
    const missed = Array(frame.step + 1 - trail.length);
    return { ...board, frame, trail: [...trail, ...missed.fill(task.mark(frame))], progress: [...progress, ...missed.fill(task.progress(frame))] };
  }
  if (frame.step > trail.length) return { ...board, frame, hasGap: true };
  return { ...board, frame, trail: [...trail, task.mark(frame)], progress: [...progress, task.progress(frame)], hasGap: false };
}

/** @param {Task} task @param {Board} board @param {MoveHistory} history @returns {Board} */
function withHistory(task, board, history) {
  const found = task.path(history, board.frame);
  if (history.episode !== board.frame.episode || found.trail.length < board.trail.length) return board;
  return { ...board, ...found, hasGap: found.trail.length <= board.frame.step };
}

/** @param {Task | null} task @param {Board | null} board @param {FromServer} message @returns {Board | null} */
export function received(task, board, message) {
  if (!board || !task) return board;
  switch (message.kind) {
    case "frame": return withFrame(task, board, message);
    case "refused": return withFrame(task, board, message.frame);
    case "history": return withHistory(task, board, message);
    case "pace": return { ...board, pace: message };
    case "remade": return message.episode === board.frame.episode ? { ...board, remade: message } : board;
    case "clock": return message.episode === board.frame.episode ? { ...board, clock: message } : board;
    default: return board;
  }
}

/** @param {GameState} state @param {string} text @param {"error" | "note"} tone @param {Role | null} role of the board that waits for
 * what it says, null where none does @returns {GameState} */
function noticed(state, text, tone, role) {
  const others = state.notices.filter((notice) => notice.text !== text);
  return { ...state, notices: [...others, { id: state.nextNotice, text, tone, role }].slice(-3), nextNotice: state.nextNotice + 1 };
}

/** Return the state with the opponent of a challenge on the second board: as far as the player, to its end once theirs has ended.
 * @param {GameState} state @returns {GameState} */
function withOpponent(state) {
  const { opponent, player, rival, task } = state;
  if (!opponent || !task || player?.frame.episode !== opponent.episode) return state;
  const { course } = opponent;
  const step = player.frame.outcome ? course.actions.length : Math.min(player.frame.step, course.actions.length);
  if (rival?.session === "" && rival.frame.step === step) return state;
  const { frame, trail } = task.boardAt(course, step);
  const progress = Array.from({ length: step + 1 }, (_, at) => task.progressAt(course, at));
  return { ...state, rival: { session: "", name: course.name, frame, trail, progress, hasGap: false, pace: null, isReplay: true } };
}

/** @param {Task | null} task @param {string} text of the server @returns the text with the plain names of policies */
const plainly = (task, text) => text.replace(/the policy '([^']+)'/g, (_, name) => task?.nameOf(name) ?? name);

/** @param {string} text whether it says that a policy is compiled for this machine: no fault, and over with its first move */
// its words are those of GETTING_READY in app/humanplay/task/__init__.py
const isGettingReady = (text) => text.includes("is getting ready");

/** @param {GameState} state @param {GameEvent} event @returns {GameState} the state after `event` */
export const apply = (state, event) => withOpponent(applied(state, event));

/** @param {GameState} state @param {GameEvent} event @returns {GameState} */
function applied(state, event) {
  switch (event.kind) {
    case "begun": {
      const { about } = event;
      const { task } = about;
      const name = about.player === "human" ? "You" : about.player;
      const player = boardOf(task, about.session, name, about.frame, state.player);
      const kept = state.rival?.isReplay && player.frame.episode === state.player?.frame.episode ? state.rival : null;
      const rival = about.rival
        ? { ...boardOf(task, about.rival.session, about.rival.policy, about.rival.frame, state.rival), pace: about.rival.pace } : kept;
      const link = about.session === state.player?.session ? state.link : "connecting"; // another session has a socket of its own
      const isNext = state.player !== null && player.frame.episode !== state.player.frame.episode;
      const notices = isNext ? [] : state.notices;
      return { ...state, task, mode: about.kind, challenges: about.challenges, level: about.map ?? about.level, size: about.size, counts: about.counts, player, rival, link, notices };
    }
    case "watched": {
      const { level, size, frame, episode: session, history, task } = event.watched;
      /** @type {Board} */
      const player = { session, name: event.name, frame, ...task.path(history, frame), hasGap: false, pace: null, isReplay: false };
      return { ...state, task, mode: "spectator", level, size, counts: false, player, rival: null };
    }
    case "replay": {
      const { about, episode } = event;
      if (state.player?.frame.episode !== episode) return state; // the player has gone on meanwhile
      return { ...state, rival: { ...boardOf(about.task, about.session, about.player, about.frame, null), isReplay: true } };
    }
    case "received": {
      const next = { ...state, [event.role]: received(state.task, state[event.role], event.message) };
      const isOver = event.role === "player" && next.player?.frame.episode !== state.player?.frame.episode;
      if (isOver && next.rival?.isReplay) next.rival = null;
      if (event.message.kind === "error") {
        const { detail } = event.message;
        const isWait = isGettingReady(detail);
        return noticed(next, plainly(state.task, spoken(event.message, detail)), isWait ? "note" : "error", isWait ? event.role : null);
      }
      const isMoved = (next[event.role]?.frame.step ?? 0) > (state[event.role]?.frame.step ?? 0);
      return isMoved && state.notices.length ? { ...next, notices: state.notices.filter(({ text }) => !isGettingReady(text)) } : next;
    }
    case "link": return { ...state, link: event.link };
    case "notice": return noticed(state, event.text, event.tone ?? "error", event.role ?? null);
    case "challenged": return { ...state, opponent: event.opponent };
    case "moved": return state.notices.length ? { ...state, notices: [] } : state; // what they said was read before the key
    case "dismiss": return { ...state, notices: state.notices.filter(({ id, text }) => id !== event.id && text !== event.text) };
  }
}

/** Return the path to draw under a board's own: the other's, once the player's episode has ended and both are on one terrain.
 * @param {GameState} state @param {Role} role @returns {Mark[] | null} */
export function ghostOf({ player, rival, task }, role) {
  if (!player?.frame.outcome || !rival || !task) return null;
  const other = role === "player" ? rival : player;
  return String(task.shape(player.frame)) === String(task.shape(rival.frame)) ? other.trail : null;
}
