// @ts-check
// Choices on their way to the server: one call at a time, each with the newest choices, so that no older ones arrive last.

/**
 * save         tells the server the choices as they are now; `signal` ends the call
 *   settle_ms    how long the choices must stand still before they are told
 *   retry_ms     how long to wait after a call that did not get through
 *   patience_ms  how long a call may take
 * @param {{save: (signal: AbortSignal) => Promise<unknown>, settle_ms?: number, retry_ms?: number, patience_ms?: number}} how
 */
export function createSaver({ save, settle_ms = 300, retry_ms = 2000, patience_ms = 15000 }) {
  /** @type {AbortController | null} the call on its way */
  let current = null;
  let isDue = false;
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let timer;

  /** @param {number} wait_ms */
  function later(wait_ms) {
    clearTimeout(timer);
    timer = setTimeout(send, wait_ms);
  }
  async function send() {
    clearTimeout(timer);
    if (current || !isDue) return;
    const call = current = new AbortController();
    const patience = setTimeout(() => call.abort(), patience_ms);
    isDue = false;
    const status = await save(call.signal).then(() => 200, (error) => error.status ?? 0);
    clearTimeout(patience);
    if (current !== call) return;
    current = null;
    const isLost = status === 0 || status >= 500; // what the server declines it would decline again
    isDue ||= isLost;
    if (isDue) later(isLost ? retry_ms : settle_ms);
  }
  return {
    /** Something was chosen. */
    tell() {
      isDue = true;
      later(settle_ms);
    },
    /** The page may go at any moment: what is not told yet is told now, in place of a call that is on its way. */
    flush() {
      if (!isDue) return;
      current?.abort();
      current = null;
      send();
    },
  };
}
