// @ts-check
// Moves that wait for their answer. A press made before the last answer came is sent with the step that it is due at, so that fast
// fingers lose little; static/play/press_queue.js keeps what is too much. The server still decides on each move, and a refusal
// drops all that follow it.
import { act } from "./messages.js";

/** @param {number} limit moves that may wait at one time @returns {PendingMoves} */
export function noMoves(limit = 4) {
  return { pending: [], limit };
}

/** Return the step that the next move is due at, or null when too many wait or the episode is over.
 * @param {PendingMoves} moves @param {Frame} frame the newest answer @returns {number | null} */
export function nextStep(moves, frame) {
  if (frame.outcome !== null || moves.pending.length >= moves.limit) return null;
  return frame.step + moves.pending.length;
}

/** @param {PendingMoves} moves @param {Pending} move @returns {PendingMoves} */
export function withMove(moves, move) {
  return { ...moves, pending: [...moves.pending, move] };
}

/** Return the moves that still wait after a frame, and those that it answered.
 * @param {PendingMoves} moves @param {Frame} frame @returns {{moves: PendingMoves, answered: Pending[]}} */
export function answeredBy(moves, frame) {
  if (moves.pending.length === 0) return { moves, answered: [] };
  const ours = moves.pending.filter((move) => move.episode === frame.episode);
  const answered = ours.filter((move) => move.step < frame.step);
  const pending = frame.outcome === null ? ours.filter((move) => move.step >= frame.step) : [];
  return { moves: { ...moves, pending }, answered };
}

/** Return no moves: after a refusal or a lost connection nothing that waits can still be current.
 * @param {PendingMoves} moves @returns {PendingMoves} */
export function withoutMoves(moves) {
  return { ...moves, pending: [] };
}

/** Return what sends a player's moves and keeps those that wait for their answer.
 *   send        true when the message left
 *   sendEvents  sends the input events that caused a move; they go before it on the same socket
 *   now_ms      performance.now
 * @param {{send: (message: object) => boolean, sendEvents: () => void, now_ms: () => number}} how */
export function createMoveSender({ send, sendEvents, now_ms }) {
  let moves = noMoves();
  /** @type {number | null} */
  let round_trip_ms = null;
  return {
    /** Send a move unless too many wait; return whether it left.
     * @param {Frame} frame @param {Action} action @param {Timing} timing @param {number} pressed_ms */
    press(frame, action, timing, pressed_ms) {
      const step = nextStep(moves, frame);
      if (step === null) return false;
      sendEvents();
      if (!send(act(frame.episode, step, action, timing))) return false;
      moves = withMove(moves, { episode: frame.episode, step, action, pressed_ms, sent_ms: now_ms() });
      return true;
    },
    /** Take the moves that a message answers off the list, and return them.
     * @param {FromServer} message */
    receive(message) {
      if (message.kind === "refused" || message.kind === "error") moves = withoutMoves(moves);
      if (message.kind !== "frame") return [];
      const { moves: rest, answered } = answeredBy(moves, message);
      moves = rest;
      const newest = answered[answered.length - 1];
      if (newest) round_trip_ms = Math.round((now_ms() - newest.sent_ms) * 10) / 10;
      return answered;
    },
    drop() { moves = withoutMoves(moves); },
    /** Return the moves that were sent and have no answer. */
    pending: () => moves.pending,
    /** Return whether as many moves wait as may wait. */
    isFull: () => moves.pending.length >= moves.limit,
    /** Return the newest round trip; null before the first answer. */
    round_trip_ms: () => round_trip_ms,
  };
}
