// @ts-check
// Finds out whether a quiet connection is a lost one. A socket that broke says so itself; a network that went silent does not,
// so a page in use asks api/health whenever no message came for a second. A page left alone asks rarely.

/**
 *   silence_ms   ms since the server's last message
 *   idle_ms      ms since the player last did something
 *   ask          api/health; rejects when no answer comes
 *   onFailure    called with the number of failures in a row
 *   onSuccess    called when an answer came after a failure
 * @param {{silence_ms: () => number, idle_ms: () => number, ask: () => Promise<unknown>,
 *   onFailure: (inARow: number) => void, onSuccess: () => void}} how */
export function startHeartbeat({ silence_ms, idle_ms, ask, onFailure, onSuccess }) {
  let failures = 0;
  let isAsking = false;
  let askedAt_ms = 0;
  return setInterval(async () => {
    const every_ms = failures > 0 || idle_ms() < 60000 ? 1000 : 15000;
    if (isAsking || document.hidden || silence_ms() < every_ms || performance.now() - askedAt_ms < every_ms) return;
    isAsking = true;
    askedAt_ms = performance.now();
    try {
      await ask();
      if (failures > 0) onSuccess();
      failures = 0;
    } catch {
      failures += 1;
      onFailure(failures);
    }
    isAsking = false;
  }, 250);
}
