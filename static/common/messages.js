// @ts-check
// Every message in both directions: the twin of app/play/messages.py (a test compares them).

/** @typedef {"north" | "east" | "south" | "west"} Action */
/** @typedef {[number, number]} Cell  a position, (row, col), row 0 at the north edge */
/** @typedef {"explored" | "collided" | "out_of_bounds" | "timed_out" | "abandoned"} Outcome */
/**
 * What a board needs, whole. `coverage` is the share of `cells` that is discovered: of all, or on maps of those that can be. `grid` holds `rows` strings of `cols` characters: ? unknown, . free, # obstacle, @ rover.
 * @typedef {{kind: "frame", episode: string, step: number, rows: number, cols: number, grid: string[], position: Cell,
 *   discovered: number, cells: number, coverage: number, heading: Action, reward: number | null, return: number | null,
 *   score: number | null, outcome: Outcome | null}} Frame  reward, return and score are null while a study keeps them to itself
 */
/** @typedef {{kind: "history", episode: string, positions: Cell[], discovered: number[]}} History */
/** @typedef {{kind: "refused", reason: string, frame: Frame}} Refused */
/** @typedef {{kind: "error", detail: string}} Problem */
/** @typedef {{kind: "pace", mode: "follow" | "timed" | "paused", moves_per_second: number}} Pace */
/**
 * What a policy computed at the frame of `step` on its own board: probabilities of ACTIONS, in their order, what it expects to earn,
 * and the cell that it heads for. Networks have the first two, rules the last.
 * @typedef {{kind: "thought", episode: string, step: number, probabilities: [number, number, number, number] | null,
 *   value: number | null, goal: Cell | null}} Thought
 */
/**
 * What a look from each cell of a policy's board is expected to show, by its map of `step` alone: [row, col, unknown cells].
 * @typedef {{kind: "expected", episode: string, step: number, cells: [number, number, number][]}} Expected
 */
/**
 * The answer to input events: all are kept, or none for a reason that will not pass; none and no reason: send them again.
 * @typedef {{kind: "kept", episode: string, count: number, reason: string | null}} Kept
 */
/** @typedef {Frame | History | Refused | Problem | Pace | Expected | Thought | Kept} FromServer */
/**
 * @typedef {{session: string, player: string, level: string, map: string | null, size: number | [number, number], counts: boolean, not_attested: string | null, watch: string | null, frame: Frame,
 *   rival: null | {session: string, policy: string, pace: Pace, frame: Frame}}} About  what POST api/sessions answers; watch: the id by which anybody may watch the board
 */
/** @typedef {{input: "key" | "touch" | null, key_down_ms: number | null, key_up_ms: number | null, client_ms: number}} Timing */

export const ACTIONS = /** @type {const} */ (["north", "east", "south", "west"]);
export const OUTCOMES = /** @type {const} */ (["explored", "collided", "out_of_bounds", "timed_out", "abandoned"]);
/** What the characters of a grid mean. */
export const CELL_STATES = Object.freeze({ "?": "unknown", ".": "free", "#": "obstacle", "@": "rover" });
export const FRAME_FIELDS = ["kind", "episode", "step", "rows", "cols", "grid", "position", "discovered", "cells", "coverage", "heading",
  "reward", "return", "score", "outcome"];
export const THOUGHT_FIELDS = ["kind", "episode", "step", "probabilities", "value", "goal"];
export const EXPECTED_FIELDS = ["kind", "episode", "step", "cells"];
export const KEPT_FIELDS = ["kind", "episode", "count", "reason"];
export const FROM_SERVER = ["frame", "history", "refused", "error", "pace", "expected", "thought", "kept"];
export const TO_SERVER = ["act", "history", "events", "expected"];

/**
 * Return the act message. `step` is the number of moves made when it is due; `action` is where the rover should go.
 * @param {string} episode
 * @param {number} step
 * @param {Action} action
 * @param {Timing} timing
 */
export function act(episode, step, action, timing) {
  return { kind: "act", episode, step, action, ...timing };
}

/**
 * A key, a touch, a focus or a pause in a study's episode; `client_ms` is performance.now.
 * @typedef {{kind: "keydown" | "keyup" | "touchdown" | "touchup" | "focus" | "blur" | "visible" | "hidden" | "pause" | "resume",
 *   code: string | null, repeat: boolean | null, trusted: boolean | null, client_ms: number, step: number | null,
 *   round_trip_ms: number | null}} InputEvent
 */

/**
 * Return the message that brings input events.
 * @param {string} episode
 * @param {InputEvent[]} batch at most 200
 * @param {string} id of the batch, by which the server knows it when it comes again
 */
export function events(episode, batch, id) {
  return { kind: "events", episode, batch: id, events: batch };
}

/** Return the request for positions and discoveries of the whole episode. */
export function askHistory() {
  return { kind: "history" };
}

/** Return the request for what a look from each cell of a policy's board is expected to show. */
export function askExpected() {
  return { kind: "expected" };
}

/**
 * Return the message in `text`, or null when it is not one of the messages above.
 * @param {string} text
 * @returns {FromServer | null}
 */
export function parse(text) {
  try {
    const message = JSON.parse(text);
    return FROM_SERVER.includes(message?.kind) ? message : null;
  } catch {
    return null;
  }
}
