// Moves that wait for their answer. A press made before the last answer came is sent with the step that it is due at, so that fast
// fingers lose little; static/play/press_queue.js keeps what is too much. The server still decides on each move, and a refusal
// drops all that follow it.
import { act } from "./messages.js";

/** Moves that may wait at one time. */
const LIMIT = 4;

/** Return what sends a player's moves and keeps those that wait for their answer.
 *   send        true when the message left
 *   sendEvents  sends the input events that caused a move; they go before it on the same socket
 * @param {{send: (message: object) => boolean, sendEvents: () => void, now_ms: () => number}} how */
export function createMoveSender({ send, sendEvents, now_ms }) {
  /** @type {Pending[]} */
  let pending = [];
  /** @type {number | null} */
  let round_trip_ms = null;
  const isFull = () => pending.length >= LIMIT;
  return {
    /** Send a move unless too many wait or the episode is over; return whether it left.
     * @param {Frame} frame the newest answer @param {Action} action @param {Timing} timing @param {number} pressed_ms */
    press({ episode, step: made, outcome }, action, timing, pressed_ms) {
      if (outcome !== null || isFull()) return false;
      const step = made + pending.length;
      sendEvents();
      if (!send(act(episode, step, action, timing))) return false;
      pending = [...pending, { episode, step, action, pressed_ms, sent_ms: now_ms() }];
      return true;
    },
    /** Take the moves that a message answers off the list, and return them: all are void after a refusal, the end and a
     * new episode.
     * @param {FromServer} message */
    receive(message) {
      if (message.kind === "refused" || message.kind === "error") pending = [];
      if (message.kind !== "frame") return [];
      const ours = pending.filter((move) => move.episode === message.episode);
      const answered = ours.filter((move) => move.step < message.step);
      pending = message.outcome === null ? ours.slice(answered.length) : [];
      const newest = answered[answered.length - 1];
      if (newest) round_trip_ms = Math.round((now_ms() - newest.sent_ms) * 10) / 10;
      return answered;
    },
    drop() { pending = []; },
    /** Return the moves that were sent and have no answer. */
    pending: () => pending,
    isFull,
    /** Return the newest round trip; null before the first answer. */
    round_trip_ms: () => round_trip_ms,
  };
}
