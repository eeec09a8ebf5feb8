// @ts-check
// The HTTP API, one function a call. URLs are relative to the page, so any mount point works.

/** An answer that was not a success; `status` is 0 when no answer came at all. */
export class ApiError extends Error {
  /**
   * @param {string} message
   * @param {number} status
   */
  constructor(message, status) {
    super(message);
    this.status = status;
  }
}

/**
 * @param {unknown} detail
 * @param {number} status one readable sentence from FastAPI's `detail`
 */
export function readDetail(detail, status) {
  if (typeof detail === "string" && detail) return detail;
  if (Array.isArray(detail)) return detail.map((item) => `${(item.loc ?? []).slice(1).join(" ")} ${item.msg}`.trim()).join("; ");
  return `The server answered ${status}.`;
}

/**
 * One call: its path below api/, a body for a POST, a promise of the parsed answer.
 * @param {typeof fetch} fetcher
 * @param {string} root the way from the page to the server's root: "" or "../"
 */
export function createCall(fetcher, root) {
  /**
   * @param {string} path
   * @param {unknown} [body]
   * @param {number} [timeout_ms]
   * @param {RequestInit} [rest]
   * @returns {Promise<any>}
   */
  return async function call(path, body, timeout_ms = 15000, rest = {}) {
    const options = body === undefined ? {} : { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) };
    let response;
    try {
      response = await fetcher(`${root}api/${path}`, { ...options, cache: "no-store", signal: AbortSignal.timeout(timeout_ms), ...rest });
    } catch {
      throw new ApiError("The server cannot be reached.", 0);
    }
    const answer = await response.json().catch(() => null);
    if (!response.ok) throw new ApiError(readDetail(answer?.detail, response.status), response.status);
    return answer;
  };
}

/**
 * @param {typeof fetch} fetcher
 * @param {string} [root]
 * @returns the calls, each a promise of the parsed answer
 */
export function createApi(fetcher, root = "") {
  const call = createCall(fetcher, root);
  /** @param {string} id */
  const session = (id) => `sessions/${encodeURIComponent(id)}`;
  return {
    health: () => call("health", undefined, 1000),
    levels: () => call("levels"),
    policies: () => call("policies"),
    humanLevel: () => call("human-level"),
    /** @param {string} id */
    episode: (id) => call(`episodes/${encodeURIComponent(id)}`),
    /** @param {Record<string, unknown>} wish */
    createSession: (wish) => call("sessions", wish),
    /** @param {string} id */
    about: (id) => call(`${session(id)}/about`, undefined, 4000),
    /**
     * @param {string} id
     * @param {Record<string, unknown>} wish
     */
    nextEpisode: (id, wish) => call(`${session(id)}/episodes`, wish),
    /**
     * @param {string} id
     * @param {Record<string, unknown>} pace
     */
    setPace: (id, pace) => call(`${session(id)}/pace`, pace),
  };
}
