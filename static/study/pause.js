// @ts-check
// How long nothing was pressed, and the pause that follows. A reload finds a paused board paused.

/** Return a timer that counts from the last press. The clock is an argument, so that node can test it.
 * @param {() => number} now_ms */
export function createIdleTimer(now_ms) {
  let touchedAt_ms = now_ms();
  return {
    touch() { touchedAt_ms = now_ms(); },
    /** @param {number} limit_s 0 never pauses @returns whether a board that waits for a key should pause */
    isOver: (limit_s) => limit_s > 0 && now_ms() - touchedAt_ms >= limit_s * 1000,
  };
}

/** Return what begins and ends pauses.
 *   episode    the id of the episode on the board, or ""
 *   note       records an input event; `flush` sends what is recorded
 *   announce   says a sentence to screen readers
 *   storage    of this tab; `key` is where the paused episode stands in it
 * @param {{idle: ReturnType<typeof createIdleTimer>, episode: () => string, note: (kind: "pause" | "resume") => void,
 *   flush: () => void, announce: (text: string) => void, dispatch: (event: Study.Event) => void, storage: Storage,
 *   key: string}} how */
export function createPause({ idle, episode, note, flush, announce, dispatch, storage, key }) {
  return {
    /** @param {boolean} isPaused */
    set(isPaused) {
      note(isPaused ? "pause" : "resume");
      idle.touch();
      if (isPaused) storage.setItem(key, episode());
      else storage.removeItem(key);
      announce(isPaused ? "Paused. Press a driving key or Go on." : "Going on.");
      dispatch({ kind: "paused", isPaused });
      flush();
    },
    /** @param {string} id @returns whether an episode was paused before a reload */
    wasPaused: (id) => storage.getItem(key) === id,
  };
}
