// The HTTP API, one function for each route. Addresses follow from this module's own, so any mount point works.

import { loadTask } from "./task.js";
import { LANGUAGE, t } from "./texts.js";

/** An answer that was not a success; `status` is 0 when no answer came at all. */
export class ApiError extends Error {
  /** @param {string} message @param {number} status */
  constructor(message, status) {
    super(message);
    this.status = status;
  }
}

/** Statuses of the server's limits and of a full disk, whose sentences are in English. */
const OF_LIMITS = [429, 507];

/** @param {unknown} detail @param {number} status @returns one readable sentence from FastAPI's `detail` */
export function readDetail(detail, status) {
  if (status === 500) return t("link.failed", "The fault is the server's, and it has noted it. Try again in a moment.");
  if (OF_LIMITS.includes(status) && LANGUAGE !== "en") return t("link.busy", "The server takes no more of this at the moment, and nothing has changed. Try again later.");
  if (typeof detail === "string" && detail) return detail;
  if (Array.isArray(detail)) return detail.map((item) => `${(item.loc ?? []).slice(1).join(" ")} ${item.msg}`.trim()).join("; ");
  return t("link.status", "The server answered {status}.", { status });
}

/** A signal that aborts by itself; Debian 12's TypeScript does not know `AbortSignal.timeout` yet. */
const Timer = /** @type {{timeout: (ms: number) => AbortSignal}} */ (/** @type {unknown} */ (AbortSignal));

/** @param {string} selector @returns an element of the page; none in a test of a module */
const find = (selector) => globalThis.document?.querySelector(selector);
const root = /** @type {HTMLMetaElement | null | undefined} */ (find("meta[name=root]"));

/** The address of the app, as the page says it; "" in a page that stands in one file, where nobody is asked. */
export const ROOT = root ? new URL(root.content, document.baseURI).href : "";

/** The answers that the page came with, by their addresses.
 * @type {Record<string, unknown>} */
const ANSWERS = JSON.parse(find("#answers")?.textContent ?? "{}");

/** Ask the server: a path below api/, a body for a POST; a promise of the parsed answer. While there is time, what is read is
 * asked for again when the server says when (503 with Retry-After).
 * @type {ApiRequest} */
export const request = async (path, body, timeout_ms = 15000, rest = {}) => {
  const language = { "accept-language": LANGUAGE };
  const options = body === undefined ? { headers: language }
    : { method: "POST", headers: { ...language, "content-type": "application/json" }, body: JSON.stringify(body) };
  const until = Date.now() + timeout_ms;
  let response;
  try {
    response = await fetch(`${ROOT}api/${path}`, { ...options, cache: "no-store", signal: Timer.timeout(timeout_ms), ...rest });
  } catch {
    throw new ApiError(t("link.unreachable", "The server cannot be reached."), 0);
  }
  const wait_ms = response.status === 503 && body === undefined ? 1000 * Number(response.headers.get("retry-after")) : 0;
  if (wait_ms > 0 && Date.now() + wait_ms < until) {
    await new Promise((resolve) => { setTimeout(resolve, wait_ms); });
    return request(path, body, until - Date.now(), rest);
  }
  const answer = await response.json().catch(() => null);
  if (!response.ok) throw new ApiError(readDetail(answer?.detail, response.status), response.status);
  return answer;
};

/** Ask for what does not change while the server runs, unless the page came with it.
 * @template T @param {string} path @returns {Promise<T>} */
const lasting = async (path) => /** @type {T | undefined} */ (ANSWERS[path]) ?? request(path);

/** @template {{task?: unknown} | null} T @param {Promise<T>} asked @returns {Promise<T>} an answer with its task's module */
export async function withTask(asked) {
  const answer = await asked;
  return answer && { ...answer, task: await loadTask(/** @type {Answers.Task} */ (answer.task)) };
}

/** How long a board may take that has to be compiled for this machine, in ms. */
const BEGIN_MS = 300_000;

/** @param {string} id */
const session = (id) => `sessions/${encodeURIComponent(id)}`;

/** Where one's own board is asked for. The page of a new browser comes with the answer that there is none, until it begins one. */
const MINE = "me/session";

/** The playground's API.
 * @type {Api} */
export const api = {
  health: () => request("health", undefined, 1000),
  task: () => lasting("task"),
  levels: () => lasting("levels"),
  maps: () => lasting("maps"),
  replay: (id) => request(`episodes/${encodeURIComponent(id)}/replay`),
  history: () => request("me/history?limit=200"),
  policies: () => lasting("policies"),
  episode: (id) => request(`episodes/${encodeURIComponent(id)}`),
  costs: (id) => request(`episodes/${encodeURIComponent(id)}/costs`, undefined, 600_000),
  act: (id, move) => request(`${session(id)}/act`, move),
  createSession(wish) {
    delete ANSWERS[MINE];
    return withTask(request("sessions", wish, BEGIN_MS));
  },
  about: (id) => withTask(request(`${session(id)}/about`, undefined, 4000)),
  mySession: async (question = {}) => (MINE in ANSWERS ? null : withTask(request(`${MINE}?${new URLSearchParams(question)}`))),
  watched: (id) => withTask(request(`watch/${encodeURIComponent(id)}`)),
  nextEpisode: (id, wish) => withTask(request(`${session(id)}/episodes`, wish, BEGIN_MS)),
  setPace: (id, pace) => request(`${session(id)}/pace`, pace),
};
