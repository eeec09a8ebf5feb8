// @ts-check
// Sends settings to the server: one request at a time, each with the newest choices, so that no older ones arrive last.

/**
 *   save         sends the choices as they are now; `signal` ends the request
 *   settle_ms    how long the choices must stay the same before they are sent
 *   retry_ms     how long to wait after a request that failed
 *   patience_ms  how long a request may take
 * @param {{save: (signal: AbortSignal) => Promise<unknown>, settle_ms?: number, retry_ms?: number,
 *   patience_ms?: number}} how */
export function createSettingsSync({ save, settle_ms = 300, retry_ms = 2000, patience_ms = 15000 }) {
  /** @type {AbortController | null} the request that waits for its answer */
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
    const request = current = new AbortController();
    const patience = setTimeout(() => request.abort(), patience_ms);
    isDue = false;
    const status = await save(request.signal).then(() => 200, (error) => error.status ?? 0);
    clearTimeout(patience);
    if (current !== request) return;
    current = null;
    const isLost = status === 0 || status >= 500; // what the server declines it would decline again
    isDue ||= isLost;
    if (isDue) later(isLost ? retry_ms : settle_ms);
  }
  return {
    /** Note that something was chosen. */
    changed() {
      isDue = true;
      later(settle_ms);
    },
    /** Send at once what is not sent yet, in place of a request without an answer: the page may go at any moment. */
    flush() {
      if (!isDue) return;
      current?.abort();
      current = null;
      send();
    },
  };
}
