// @ts-check
// The whole state of the page in one object. `apply` returns the next state and changes nothing that it was given.

/** @returns {GameState} */
export function initialState() {
  return { mode: "practice", level: "random", size: 21, counts: false, player: null, rival: null, link: "connecting", notices: [],
    nextNotice: 1 };
}

/** @param {About} about @returns {Mode} the mode that a session stands for */
export function modeOf(about) {
  if (about.player !== "human") return "watch";
  return about.rival ? "practice" : "ranked";
}

/** @param {string} session @param {string} name @param {Frame} frame @param {Board | null} before @returns {Board} */
function boardOf(session, name, frame, before) {
  if (before && before.session === session) return { ...withFrame(before, frame), name };
  return withFrame({ session, name, frame, trail: [], discovered: [], hasGap: false, pace: null, isReplay: false }, frame);
}

/** Return the board after `frame`: the newest wins, an older one of the same episode changes nothing.
 * @param {Board} board @param {Frame} frame @returns {Board} */
export function withFrame(board, frame) {
  const isNew = frame.episode !== board.frame.episode;
  if (!isNew && frame.step < board.frame.step) return board;
  if (isNew) board = { ...board, thought: null, values: [], expected: null };
  const trail = isNew ? [] : board.trail;
  const discovered = isNew ? [] : board.discovered;
  if (frame.step < trail.length) return { ...board, frame, trail, discovered };
  if (frame.step > trail.length) return { ...board, frame, trail, discovered, hasGap: true };
  return { ...board, frame, trail: [...trail, frame.position], discovered: [...discovered, frame.discovered], hasGap: false };
}

/** @param {Board} board @param {MoveHistory} history @returns {Board} */
function withHistory(board, history) {
  if (history.episode !== board.frame.episode || history.positions.length < board.trail.length) return board;
  const { positions: trail, discovered } = history;
  return { ...board, trail, discovered, hasGap: trail.length <= board.frame.step };
}

/** @param {Board} board @param {Thought} thought @returns {Board} */
function withThought(board, thought) {
  if (thought.episode !== board.frame.episode) return board;
  const values = [...(board.values ?? [])];
  values[thought.step] = thought.value;
  return { ...board, thought, values };
}

/** @param {Board | null} board @param {FromServer} message @returns {Board | null} */
function received(board, message) {
  if (!board) return board;
  switch (message.kind) {
    case "frame": return withFrame(board, message);
    case "refused": return withFrame(board, message.frame);
    case "history": return withHistory(board, message);
    case "thought": return withThought(board, message);
    case "expected": return message.episode === board.frame.episode ? { ...board, expected: message } : board;
    case "pace": return { ...board, pace: message };
    default: return board;
  }
}

/** @param {GameState} state @param {string} text @param {"error" | "note"} tone @returns {GameState} */
function noticed(state, text, tone) {
  const others = state.notices.filter((notice) => notice.text !== text);
  return { ...state, notices: [...others, { id: state.nextNotice, text, tone }].slice(-3), nextNotice: state.nextNotice + 1 };
}

/** @param {GameState} state @param {GameEvent} event @returns {GameState} the state after `event` */
export function apply(state, event) {
  switch (event.kind) {
    case "begun": {
      const { about } = event;
      const name = about.player === "human" ? "You" : about.player;
      const player = boardOf(about.session, name, about.frame, state.player);
      const kept = state.rival?.isReplay && player.frame.episode === state.player?.frame.episode ? state.rival : null;
      const rival = about.rival
        ? { ...boardOf(about.rival.session, about.rival.policy, about.rival.frame, state.rival), pace: about.rival.pace } : kept;
      const link = about.session === state.player?.session ? state.link : "connecting"; // another session has a socket of its own
      return { ...state, mode: modeOf(about), level: about.map ?? about.level, size: about.size, counts: about.counts, player, rival, link };
    }
    case "watched": {
      const { level, size, board } = event;
      return { ...state, mode: "spectator", level, size, counts: false, player: board, rival: null };
    }
    case "replay": {
      const { about, episode } = event;
      if (state.player?.frame.episode !== episode) return state; // the player has gone on meanwhile
      return { ...state, rival: { ...boardOf(about.session, about.player, about.frame, null), isReplay: true } };
    }
    case "received": {
      const next = { ...state, [event.role]: received(state[event.role], event.message) };
      const isOver = event.role === "player" && next.player?.frame.episode !== state.player?.frame.episode;
      if (isOver && next.rival?.isReplay) next.rival = null;
      return event.message.kind === "error" ? noticed(next, event.message.detail, "error") : next;
    }
    case "link": return { ...state, link: event.link };
    case "notice": return noticed(state, event.text, event.tone ?? "error");
    case "dismiss": return { ...state, notices: state.notices.filter((notice) => notice.id !== event.id) };
  }
}
