// @ts-check
// How long the keys have been still. The clock is an argument, so node can test it.

/** @param {() => number} now_ms */
export function createIdle(now_ms) {
  let touchedAt_ms = now_ms();
  return {
    touch() { touchedAt_ms = now_ms(); },
    /**
     * Whether a board that waits for a key should pause.
     * @param {number} limit_s 0 never pauses
     */
    isOver: (limit_s) => limit_s > 0 && now_ms() - touchedAt_ms >= limit_s * 1000,
    /** When the pause really began. */
    since_ms: () => touchedAt_ms,
  };
}
