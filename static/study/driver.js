// @ts-check
// Moves on their way to the server and back, and how long the way took.
import { answeredBy, dropped, emptyPipeline, nextStep, sent } from "../common/pending_moves.js";
import { act } from "../common/messages.js";

/**
 * send     true when the message left
 *   now_ms   performance.now
 * @param {{send: (message: object) => boolean, now_ms: () => number}} how
 */
export function createDriver({ send, now_ms }) {
  let line = emptyPipeline();
  /** @type {number | null} */
  let round_trip_ms = null;
  return {
    /**
     * Sends a move if the line has room.
     * @param {import("../common/messages.js").Frame} frame
     * @param {import("../common/messages.js").Action} action
     * @param {import("../common/messages.js").Timing} timing
     */
    press(frame, action, timing) {
      const step = nextStep(line, frame);
      if (step !== null && send(act(frame.episode, step, action, timing))) line = sent(line, { episode: frame.episode, step, sent: now_ms() });
    },
    /**
     * Moves that a message answers leave the line.
     * @param {import("../common/messages.js").FromServer} message
     */
    heard(message) {
      if (message.kind === "refused" || message.kind === "error") line = dropped(line);
      if (message.kind !== "frame") return;
      const { line: rest, answered } = answeredBy(line, message);
      line = rest;
      const newest = answered.at(-1);
      if (newest) round_trip_ms = Math.round((now_ms() - newest.sent) * 10) / 10;
    },
    drop() { line = dropped(line); },
    round_trip_ms: () => round_trip_ms,
  };
}
