// @ts-check
// The HTTP API, one function for each route. URLs are relative to the page, so any mount point works.

import { loadTask } from "./task.js";

/** An answer that was not a success; `status` is 0 when no answer came at all. */
export class ApiError extends Error {
  /** @param {string} message @param {number} status */
  constructor(message, status) {
    super(message);
    this.status = status;
  }
}

/** @param {unknown} detail @param {number} status @returns one readable sentence from FastAPI's `detail` */
export function readDetail(detail, status) {
  if (typeof detail === "string" && detail) return detail;
  if (Array.isArray(detail)) return detail.map((item) => `${(item.loc ?? []).slice(1).join(" ")} ${item.msg}`.trim()).join("; ");
  return `The server answered ${status}.`;
}

/** A signal that aborts by itself; Debian 12's TypeScript does not know `AbortSignal.timeout` yet. */
const Timer = /** @type {{timeout: (ms: number) => AbortSignal}} */ (/** @type {unknown} */ (AbortSignal));

/** Return the function that asks the server: a path below api/, a body for a POST, a promise of the parsed answer.
 * @param {typeof fetch} fetcher @param {string} root the path from the page to the server's root: "" or "../"
 * @returns {ApiRequest} */
export function createRequest(fetcher, root) {
  return async function request(path, body, timeout_ms = 15000, rest = {}) {
    const options = body === undefined ? {} : { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) };
    let response;
    try {
      response = await fetcher(`${root}api/${path}`, { ...options, cache: "no-store", signal: Timer.timeout(timeout_ms), ...rest });
    } catch {
      throw new ApiError("The server cannot be reached.", 0);
    }
    const answer = await response.json().catch(() => null);
    if (!response.ok) throw new ApiError(readDetail(answer?.detail, response.status), response.status);
    return answer;
  };
}

/** @template {{task?: unknown} | null} T @param {Promise<T>} asked @returns {Promise<T>} an answer with its task's module */
export async function withTask(asked) {
  const answer = await asked;
  return answer && { ...answer, task: await loadTask(/** @type {TaskAbout | undefined} */ (answer.task)) };
}

/** @param {typeof fetch} fetcher @param {string} [root] @returns the playground's API */
export function createApi(fetcher, root = "") {
  const request = createRequest(fetcher, root);
  /** @param {string} id */
  const session = (id) => `sessions/${encodeURIComponent(id)}`;
  return {
    /** @returns {Promise<unknown>} */
    health: () => request("health", undefined, 1000),
    /** @returns {Promise<Mars.Level[]>} */
    levels: () => request("levels"),
    /** @returns {Promise<Mars.GivenMap[]>} */
    maps: () => request("maps"),
    /** @returns {Promise<Choice[]>} */
    policies: () => request("policies"),
    /** @returns {Promise<HumanLevel>} */
    humanLevel: () => request("human-level"),
    /** @param {string} id
     * @returns {Promise<{seed: number | null, level: string, rows: number, cols: number, actions: string[]}>} */
    episode: (id) => request(`episodes/${encodeURIComponent(id)}`),
    /** @param {string} id of a finished episode @returns {Promise<Mars.Analysis>} */
    regret: (id) => request(`episodes/${encodeURIComponent(id)}/regret`, undefined, 600_000),
    /** Make a move that no key made.
     * @param {string} id @param {{episode: string, step: number, action: string}} move @returns {Promise<Frame>} */
    act: (id, move) => request(`${session(id)}/act`, move),
    /** @param {Record<string, unknown>} wish @returns {Promise<About>} */
    createSession: (wish) => withTask(request("sessions", wish)),
    /** @param {string} id @returns {Promise<About>} */
    about: (id) => withTask(request(`${session(id)}/about`, undefined, 4000)),
    /** Return the board that this browser's player goes on with; null without one. A question names another of their
     * boards: by its id, or by what a link to watch it holds.
     * @param {{session?: string, watch?: string}} [question] @returns {Promise<About | null>} */
    mySession: (question = {}) => withTask(request(`me/session?${new URLSearchParams(question)}`)),
    /** @param {string} id of a board for watching, or of an episode @returns {Promise<Watched>} */
    watched: (id) => withTask(request(`watch/${encodeURIComponent(id)}`)),
    /** @param {string} id @param {Record<string, unknown>} wish @returns {Promise<About>} */
    nextEpisode: (id, wish) => withTask(request(`${session(id)}/episodes`, wish)),
    /** @param {string} id @param {Record<string, unknown>} pace @returns {Promise<Pace>} */
    setPace: (id, pace) => request(`${session(id)}/pace`, pace),
  };
}
