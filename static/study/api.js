// The study's API, and the types of its answers.
import { request, withTask } from "../common/api.js";

/** @param {string} pathname @returns the study's name in the page's address */
export const studyName = (pathname) => decodeURIComponent(/\/study\/([^/]*)\/?$/.exec(pathname)?.[1] ?? "");

/** One more than an ID may have: the server refuses what is longer, and no two of the same beginning become one. */
const MOST_CHARACTERS = 201;

/** Return the ids that another site put into the address, all of them where a name is there more than once; the server knows
 * which it wants.
 * @param {string} search @returns {Record<string, string | string[]>} */
export function outsideIds(search) {
  const parameters = new URLSearchParams(search);
  const names = [...new Set(parameters.keys())].filter((name) => name && name.length <= 64 && name !== "invitation").slice(0, 20);
  const ids = names.map((name) => /** @type {const} */ ([name, parameters.getAll(name).map((id) => id.slice(0, MOST_CHARACTERS)).slice(0, 20)]));
  return Object.fromEntries(ids.map(([name, all]) => [name, all.length === 1 ? all[0] : all]));
}

/** @param {string} search @returns the invitation's token in the page's address; null without one */
export const invitationIn = (search) => new URLSearchParams(search).get("invitation") || null;

/** @param {string} hash @returns {string | null} the token of a link from another device, which no server's log has seen */
export const ticketIn = (hash) => /^#go=(.+)$/.exec(hash)?.[1] ?? null;

/** Return the page's address without the invitation, the ids of a platform and a token: whoever copies it hands on nothing.
 * @param {string} href */
export function bareAddress(href) {
  const url = new URL(href);
  url.search = "";
  if (ticketIn(url.hash)) url.hash = "";
  return url.href;
}

/** @param {string} name of the study @returns {Study.Api} */
export function createStudyApi(name) {
  const path = `studies/${encodeURIComponent(name)}`;
  /** Ask, and return the participant as it is then, with the task's module.
   * @param {string} rest @param {unknown} [body] @param {number} [timeout_ms] @param {RequestInit} [options]
   * @returns {Promise<Study.Participant>} */
  const ask = async (rest, body, timeout_ms, options) => {
    /** @type {Study.Participant} */
    const participant = await withTask(request(`${path}/${rest}`, body, timeout_ms, options));
    return participant.about ? { ...participant, about: { ...participant.about, task: participant.task } } : participant;
  };
  return {
    show: () => request(path),
    join: (outside_ids, invitation) => ask("join", { outside_ids, invitation }),
    me: () => ask("me", undefined, 5000),
    consent: (version, agree, unfit = false) => ask("consent", { version, agree, unfit }),
    advance: (from) => ask("advance", { from }),
    answers: (answers) => ask("answers", { answers }),
    block: (block, turn, answers) => ask("block", { block, turn, answers }),
    skip: (block, turn) => ask("skip", { block, turn }),
    next: () => ask("next", {}),
    giveUp: (episode, step) => ask("give-up", { episode, step }),
    settings: (settings, signal) => ask("settings", settings, undefined, { keepalive: true, signal }),
    supervise: (code) => ask("supervise", { code }),
    elsewhere: (page) => request(`${path}/elsewhere`, { page }),
    goOn: (brings) => ask("go-on", brings),
    withdraw: (/** @type {boolean} */ erase) => ask("withdraw", { erase }),
    terrain: (index, phase) => request(`${path}/debrief/${index}?phase=${phase}`),
    costs: (index, phase) => request(`${path}/debrief/${index}/costs?phase=${phase}`, undefined, 600_000),
  };
}
