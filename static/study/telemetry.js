// @ts-check
// What the fingers did and where the eyes were, kept until a batch can leave: one episode a batch, in order, 200 events at most.
import { events } from "../protocol.js";

/** @typedef {import("../protocol.js").InputEvent} InputEvent */
export const MOST_EVENTS = 200;
/** Events kept while there is no connection; the oldest go first. */
export const MOST_KEPT = 5000;

/** The events that stand first and belong to one episode. @param {{episode: string, event: InputEvent}[]} waiting */
export function nextBatch(waiting) {
  const episode = waiting[0]?.episode;
  let count = 0;
  while (count < Math.min(waiting.length, MOST_EVENTS) && waiting[count].episode === episode) count += 1;
  return { episode, batch: waiting.slice(0, count).map(({ event }) => event), count };
}

/**
 *   context   the episode and step on screen and the newest round trip; episode null while no board is shown: then nothing is kept
 *   send      true when the message left
 * @param {{context: () => {episode: string | null, step: number | null, round_trip_ms: number | null}, now_ms: () => number,
 *   send: (message: object) => boolean}} how
 */
export function createTelemetry({ context, now_ms, send }) {
  /** @type {{episode: string, event: InputEvent}[]} */
  let waiting = [];
  return {
    /** @param {InputEvent["kind"]} kind @param {{code?: string, repeat?: boolean, trusted?: boolean, at_ms?: number}} [fields] */
    note(kind, { code, repeat, trusted, at_ms } = {}) {
      const { episode, step, round_trip_ms } = context();
      if (episode === null) return;
      const client_ms = Math.round((at_ms ?? now_ms()) * 10) / 10;
      waiting.push({ episode, event: { kind, code: code ?? null, repeat: repeat ?? null, trusted: trusted ?? null, client_ms, step, round_trip_ms } });
      if (waiting.length > MOST_KEPT) waiting = waiting.slice(-MOST_KEPT);
    },
    /** Sends what waits, if there is a line. */
    flush() {
      while (waiting.length > 0) {
        const { episode, batch, count } = nextBatch(waiting);
        if (!send(events(episode, batch))) return;
        waiting = waiting.slice(count);
      }
    },
    waiting: () => waiting.length,
  };
}
