// @ts-check
// The debrief's replay: the participant's run and a policy's on one terrain, step by step. Pure: a tick returns the next replay.

/**
 * @typedef {import("../common/messages.js").Frame} Frame
 */
/** @typedef {{own: Frame[], policy: {name: string, frames: Frame[]}}} Runs  what GET debrief/{index} answers */
/** @typedef {{index: number, runs: Runs, step: number, isPlaying: boolean}} Replay */

/**
 * @param {number} index
 * @param {Runs} runs
 * @returns {Replay}
 */
export const begun = (index, runs) => ({ index, runs, step: 0, isPlaying: false });

/**
 * Return the last step of the longer run.
 * @param {Replay} replay
 */
export const lastStep = ({ runs }) => Math.max(0, ...[runs.own, runs.policy.frames].map((frames) => frames.at(-1)?.step ?? 0));

/**
 * Return the replay one step later; at the end it stops.
 * @param {Replay} replay
 * @returns {Replay}
 */
export function stepped(replay) {
  const step = Math.min(replay.step + 1, lastStep(replay));
  return { ...replay, step, isPlaying: replay.isPlaying && step < lastStep(replay) };
}

/**
 * Return the replay at another step, not playing.
 * @param {Replay} replay
 * @param {number} step
 * @returns {Replay}
 */
export const moved = (replay, step) => ({ ...replay, step: Math.max(0, Math.min(step, lastStep(replay))), isPlaying: false });

/**
 * Return the replay playing, from its start if it was at its end, or not playing any more.
 * @param {Replay} replay
 * @returns {Replay}
 */
export function toggled(replay) {
  if (replay.isPlaying) return { ...replay, isPlaying: false };
  return { ...replay, isPlaying: true, step: replay.step >= lastStep(replay) ? 0 : replay.step };
}
