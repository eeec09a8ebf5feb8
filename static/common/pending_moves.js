// @ts-check
// Moves on their way. A press made before the last answer came is sent with the step it is due at, so fast fingers lose nothing;
// the server still judges each one, and a refusal drops all that stood behind it.

/** @typedef {{episode: string, step: number, sent: number}} Pending */
/** @typedef {{pending: readonly Pending[], limit: number}} Pipeline */

/**
 * @param {number} limit moves that may wait for their answer
 * @returns {Pipeline}
 */
export function emptyPipeline(limit = 4) {
  return { pending: [], limit };
}

/**
 * The step the next move is due at, or null when the line is full or the episode is over.
 * @param {Pipeline} line
 * @param {import("./messages.js").Frame} frame the newest answer
 * @returns {number | null}
 */
export function nextStep(line, frame) {
  if (frame.outcome !== null || line.pending.length >= line.limit) return null;
  return frame.step + line.pending.length;
}

/**
 * @param {Pipeline} line
 * @param {Pending} move
 * @returns {Pipeline}
 */
export function sent(line, move) {
  return { ...line, pending: [...line.pending, move] };
}

/**
 * The line after a frame, and the moves that it answered.
 * @param {Pipeline} line
 * @param {import("./messages.js").Frame} frame
 * @returns {{line: Pipeline, answered: Pending[]}}
 */
export function answeredBy(line, frame) {
  if (line.pending.length === 0) return { line, answered: [] };
  const ours = line.pending.filter((move) => move.episode === frame.episode);
  const answered = ours.filter((move) => move.step < frame.step);
  const pending = frame.outcome === null ? ours.filter((move) => move.step >= frame.step) : [];
  return { line: { ...line, pending }, answered };
}

/**
 * An empty line: after a refusal or a lost connection nothing that waits can still be current.
 * @param {Pipeline} line
 */
export function dropped(line) {
  return { ...line, pending: [] };
}
