// The player of finished episodes, for a replay's page and a study's debrief: where the playback stands and how it goes on.

/** Moves per second. */
export const SPEEDS = Object.freeze([1, 2, 4, 8, 16, 32, 64]);
/** Seconds that a whole replay takes at most, where a speed allows it. */
const WHOLE_S = 15;
/** Moves that an arrow key with Shift goes. */
const FAR = 10;

/** Return the start of a replay of `last` moves; without a speed, at one that shows all of it soon.
 * @param {number} last @param {number} [speed] moves per second @returns {Playback} */
export function begun(last, speed) {
  const fitting = SPEEDS.find((each) => each >= 8 && last / each <= WHOLE_S) ?? SPEEDS[SPEEDS.length - 1];
  return { at: 0, last, isPlaying: false, speed: speed ?? fitting, hovered: null };
}

/** @param {Playback} playback @returns the number of moves after which the boards are shown */
export const stepOf = ({ at, hovered, isPlaying }) => hovered !== null && !isPlaying ? hovered : Math.floor(at + 1e-9);

/** @param {Playback} playback @param {number} step @returns {Playback} the replay at another move, not playing */
export function movedTo(playback, step) {
  return { ...playback, at: Math.max(0, Math.min(Math.round(step), playback.last)), isPlaying: false, hovered: null };
}

/** Return the replay with another longest run: it stays at its move.
 * @param {Playback} playback @param {number} last @returns {Playback} */
export const withLast = (playback, last) => ({ ...playback, last, at: Math.min(playback.at, last) });

/** Return the replay playing, from the start where it was at its end, or paused.
 * @param {Playback} playback @returns {Playback} */
export function toggled(playback) {
  if (playback.isPlaying) return { ...playback, at: Math.floor(playback.at), isPlaying: false };
  return { ...playback, isPlaying: true, hovered: null, at: playback.at >= playback.last ? 0 : playback.at };
}

/** @param {Playback} playback @param {number} seconds @returns {Playback} the replay some time later */
export function later(playback, seconds) {
  if (!playback.isPlaying) return playback;
  const at = Math.min(playback.last, playback.at + seconds * playback.speed);
  return { ...playback, at, isPlaying: at < playback.last };
}

/** @param {Playback} playback @param {1 | -1} direction @returns {Playback} the replay at the next speed up or down */
function faster(playback, direction) {
  const index = SPEEDS.indexOf(playback.speed) + direction;
  return { ...playback, speed: SPEEDS[Math.max(0, Math.min(index, SPEEDS.length - 1))] };
}

/** Return the replay after a key; null for a key that is none of its own.
 * @param {Playback} playback @param {string} key `event.key` @param {boolean} [isFar] Shift is down
 * @returns {Playback | null} */
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

/** Return a player: it holds where the playback stands, and runs the clock while it plays.
 * @param {Playback} playback to begin with @param {(playback: Playback, before: Playback) => void} onChange */
export function createPlayer(playback, onChange) {
  let shownAt_ms = 0;
  /** @param {number} now_ms */
  function tick(now_ms) {
    if (!playback.isPlaying) return;
    show(later(playback, Math.min(0.25, (now_ms - shownAt_ms) / 1000)));
    shownAt_ms = now_ms;
    if (playback.isPlaying) requestAnimationFrame(tick);
  }
  /** Show another state of the playback.
   * @param {Playback} next */
  function show(next) {
    const before = playback;
    playback = next;
    if (next.isPlaying && !before.isPlaying) {
      requestAnimationFrame((now_ms) => {
        shownAt_ms = now_ms;
        requestAnimationFrame(tick);
      });
    }
    onChange(next, before);
  }
  return {
    get playback() { return playback; },
    get step() { return stepOf(playback); },
    show,
    /** @param {number} step */
    goTo: (step) => show(movedTo(playback, step)),
    /** @param {number | null} hovered */
    hover: (hovered) => { if (!playback.isPlaying) show({ ...playback, hovered }); },
    /** Do what a key stands for, and return whether it is one of the player's own.
     * @param {string} key @param {boolean} [isFar] */
    press(key, isFar) {
      const next = keyed(playback, key, isFar);
      if (next) show(next);
      return next !== null;
    },
  };
}
