// The whole state of the study's page in one object. `apply` returns the next state; `screenOf` says which screen belongs to it.
import * as gameState from "../common/game_state.js";

/** @returns {Study.State} */
export function initialState() {
  return { game: gameState.initialState(), participant: null, problem: null, passed: null, isPaused: false, replay: null, looksBack: false };
}

/** @param {Study.State} state @param {Study.Participant} participant @returns {Study.State} */
function arrived(state, participant) {
  const game = participant.about ? gameState.apply(state.game, { kind: "begun", about: participant.about }) : { ...state.game, player: null };
  return settled({ ...state, participant, game, problem: participant.stage === "withdrawn" ? null : participant.note ?? null });
}

/** @param {Study.State} state @returns {Study.State} the state without a pause that its episode has outlived */
function settled(state) {
  const frame = state.game.player?.frame;
  return state.isPaused && (!frame || frame.outcome) ? { ...state, isPaused: false } : state;
}

/** @param {Study.State} state @param {Study.Event} event @returns {Study.State} the state after `event` */
export function apply(state, event) {
  switch (event.kind) {
    case "participant": return arrived(state, event.participant);
    case "problem": return { ...state, problem: event.text };
    case "passed": return { ...state, passed: event.episode };
    case "paused": return state.isPaused === event.isPaused ? state : settled({ ...state, isPaused: event.isPaused });
    case "replay-moved": return { ...state, replay: event.replay };
    case "looked-back": return { ...state, looksBack: event.looksBack };
    default: {
      const game = gameState.apply(state.game, event);
      return game === state.game ? state : settled({ ...state, game });
    }
  }
}

const FOLLOWS = { tutorial: "tutorial", warm_up: "ranked", ranked: "debrief" };

/** Return whether an episode that has ended still belongs on the screen: it is of this stage, or was the last of the
 * one before.
 * @param {Study.Participant} participant */
const endsHere = ({ stage, phase }) => phase !== null && (stage === phase || stage === FOLLOWS[phase]);

/** Return the screen of a state: the participant's stage, or the board that belongs to it.
 * @param {Study.State} state @returns {Study.Screen} */
export function screenOf({ participant, game, passed, problem, looksBack }) {
  if (problem !== null) return "problem";
  if (!participant) return "loading";
  const { stage } = participant;
  const frame = game.player?.frame;
  if (frame && endsHere(participant) && (!frame.outcome || frame.episode !== passed)) return "play";
  if (participant.block) return "block";
  if (stage === "tutorial" || stage === "warm_up" || stage === "ranked") return stage === "ranked" && participant.break_due ? "break" : "ready";
  return stage === "complete" && looksBack ? "debrief" : stage;
}

/** @param {Study.State} state @returns whether the board waits for a move */
export const isDriving = (state) => screenOf(state) === "play" && state.game.player?.frame.outcome === null;

/** @param {Study.State} state @returns whether the server's answer knows the end of the episode on the board */
export function knowsTheEnd({ participant, game }) {
  const frame = game.player?.frame;
  return Boolean(frame?.outcome && participant?.about?.frame.episode === frame.episode && participant.about.frame.outcome);
}

/** Return whether the next episode follows at once: the same stage goes on and no break is due.
 * @param {Study.Participant} participant */
export const goesOn = (participant) => participant.stage === participant.phase && !participant.break_due && !participant.block && !isNewTry(participant);

/** @param {Study.Participant} participant @returns whether another try at the practice follows the episode that has ended */
export const isNewTry = ({ stage, phase, warm_up }) => stage === "warm_up" && phase === "warm_up" && warm_up.done === 0;

/** Return a timer that counts from the last press. The clock is an argument, so that node can test it.
 * @param {() => number} now_ms */
export function createIdleTimer(now_ms) {
  let touchedAt_ms = now_ms();
  return {
    touch() { touchedAt_ms = now_ms(); },
    /** @param {number} limit_s 0 never pauses @returns whether a board that waits for a key should pause */
    isOver: (limit_s) => limit_s > 0 && now_ms() - touchedAt_ms >= limit_s * 1000,
  };
}
