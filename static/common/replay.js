// @ts-check
// The board of a recorded run at one of its steps.

/**
 * @typedef {import("./messages.js").Frame} Frame
 * @typedef {import("./game_state.js").Board} Board
 */

/**
 * Return a run's board as it stood after `step` moves; one that ended before stays at its end. Long runs come with frames
 * left out.
 * @param {Frame[]} frames
 * @param {string} name
 * @param {number} step
 * @returns {Board | null}
 */
export function boardAt(frames, name, step) {
  if (frames.length === 0) return null;
  const shown = frames.filter((frame) => frame.step <= step);
  return { session: name, name, frame: shown[shown.length - 1], trail: shown.map(({ position }) => position),
    discovered: shown.map(({ discovered }) => discovered), hasGap: false, pace: null, isReplay: true };
}
