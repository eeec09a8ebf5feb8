// @ts-check
// Where a replay stands, and how it goes on. Every function returns the next state and changes nothing that it was given.

/**
 * at       moves, with the part of the next one that has passed; the board shown is that after the whole ones
 * hovered  the move under the pointer, shown instead while nothing plays
 * @typedef {{at: number, last: number, isPlaying: boolean, speed: number, hovered: number | null}} Playback
 */

/** Moves per second. */
export const SPEEDS = Object.freeze([1, 2, 4, 8, 16, 32, 64]);
/** Seconds that a whole replay takes at most, where a speed allows it. */
const WHOLE_S = 15;
/** Moves that an arrow key with Shift goes. */
const FAR = 10;

/**
 * Return the start of a replay of `last` moves, at a speed that shows all of it soon.
 * @param {number} last
 * @returns {Playback}
 */
export function begun(last) {
  return { at: 0, last, isPlaying: false, speed: SPEEDS.find((speed) => speed >= 8 && last / speed <= WHOLE_S) ?? SPEEDS[SPEEDS.length - 1], hovered: null };
}

/**
 * Return the number of moves after which the boards are shown.
 * @param {Playback} playback
 */
export const stepOf = ({ at, hovered, isPlaying }) => (hovered !== null && !isPlaying ? hovered : Math.floor(at + 1e-9));

/**
 * Return the replay at another move, not playing.
 * @param {Playback} playback
 * @param {number} step
 * @returns {Playback}
 */
export const movedTo = (playback, step) => ({ ...playback, at: Math.max(0, Math.min(Math.round(step), playback.last)), isPlaying: false, hovered: null });

/**
 * Return the replay with another longest run: it stays at its move.
 * @param {Playback} playback
 * @param {number} last
 * @returns {Playback}
 */
export const withLast = (playback, last) => ({ ...playback, last, at: Math.min(playback.at, last) });

/**
 * Return the replay playing, from the start where it was at its end, or paused.
 * @param {Playback} playback
 * @returns {Playback}
 */
export function toggled(playback) {
  if (playback.isPlaying) return { ...playback, at: Math.floor(playback.at), isPlaying: false };
  return { ...playback, isPlaying: true, hovered: null, at: playback.at >= playback.last ? 0 : playback.at };
}

/**
 * Return the replay some time later.
 * @param {Playback} playback
 * @param {number} seconds
 * @returns {Playback}
 */
export function later(playback, seconds) {
  if (!playback.isPlaying) return playback;
  const at = Math.min(playback.last, playback.at + seconds * playback.speed);
  return { ...playback, at, isPlaying: at < playback.last };
}

/**
 * Return the replay at the next speed up or down.
 * @param {Playback} playback
 * @param {1 | -1} direction
 * @returns {Playback}
 */
export function faster(playback, direction) {
  const index = SPEEDS.indexOf(playback.speed) + direction;
  return { ...playback, speed: SPEEDS[Math.max(0, Math.min(index, SPEEDS.length - 1))] };
}

/**
 * Return the replay after a key; null for a key that is none of its own.
 * @param {Playback} playback
 * @param {string} key `event.key`
 * @param {boolean} [isFar] Shift is down
 * @returns {Playback | null}
 */
export function keyed(playback, key, isFar = false) {
  const step = stepOf(playback);
  switch (key) {
    case " ": return toggled(playback);
    case "ArrowRight": case "ArrowUp": return movedTo(playback, step + (isFar ? FAR : 1));
    case "ArrowLeft": case "ArrowDown": return movedTo(playback, step - (isFar ? FAR : 1));
    case "PageUp": return movedTo(playback, step + FAR);
    case "PageDown": return movedTo(playback, step - FAR);
    case "Home": return movedTo(playback, 0);
    case "End": return movedTo(playback, playback.last);
    case "+": case "=": return faster(playback, 1);
    case "-": case "_": return faster(playback, -1);
    default: return null;
  }
}
