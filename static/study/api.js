// @ts-check
// The study's API, and the types of its answers.

/** @typedef {"consent" | "instructions" | "tutorial" | "questions" | "warm_up" | "ranked" | "debrief" | "complete" | "withdrawn"} Stage */
/** @typedef {"tutorial" | "warm_up" | "ranked"} Phase */
/** @typedef {{own: import("../common/messages.js").Frame[], policy: {name: string, frames: import("../common/messages.js").Frame[]}}} Runs  what GET debrief/{index} answers */
/** @typedef {"mars" | "colour-blind" | "high-contrast"} PaletteName */
/** @typedef {{modality: "keyboard" | "touch", palette: PaletteName, keys: import("./keymap.js").KeyMap}} Settings */
/**
 * Own figures and codes; null before the debrief.
 * @typedef {{mean_score: number | null, mean_steps: number | null, episodes: {trial: number, outcome: string, steps: number, score: number}[],
 *   policy: {name: string, mean_steps_warm_up: number | null, own_mean_steps_warm_up: number | null} | null, warm_up_terrains: number, ranked_terrains: number,
 *   completion_code: string | null, return_url: string | null}} Debrief
 */
/**
 * What the server says of a participant: the answer to every request but `show` and `terrain`.
 * @typedef {{study: string, title: string, participant: string, stage: Stage, consent: {version: string, text: string},
 *   questions: {question: string, choices: string[]}[], right: boolean[] | null, why?: string[] | null,
 *   warm_up: {done: number, of: number}, ranked: {done: number, of: number}, tutorial: {done: boolean}, break_due: boolean,
 *   pause_after_s: number, rules: {coverage: string, lidar_radius: string, max_steps: string}, session: string | null, about: import("../common/messages.js").About | null, phase: Phase | null,
 *   settings: {modality?: Settings["modality"] | null, palette?: PaletteName | null, keys?: import("./keymap.js").KeyMap | null},
 *   debrief: Debrief | null, note?: string | null, invited: boolean, supervised_until_ms: number | null}} Participant
 * note: why nobody can go on here, or what is kept of one who left
 */

/**
 * Return the study's name in the page's address.
 * @param {string} pathname
 */
export function studyName(pathname) {
  return decodeURIComponent(/\/study\/([^/]*)\/?$/.exec(pathname)?.[1] ?? "");
}

/**
 * Return the ids that another site put into the address: each name once, no empty ones; the server knows which it wants.
 * @param {string} search
 */
export function outsideIds(search) {
  const found = [...new URLSearchParams(search)].filter(([name, value]) => name && value && name.length <= 64 && value.length <= 200);
  return Object.fromEntries(found.slice(0, 20));
}

/**
 * Return the invitation's token in the page's address; null without one.
 * @param {string} search
 */
export const invitationIn = (search) => new URLSearchParams(search).get("invitation") || null;

/**
 * Return the page's address without the invitation's token: whoever copies it afterwards hands on nothing.
 * @param {string} href
 */
export function withoutInvitation(href) {
  const url = new URL(href);
  if (!url.searchParams.has("invitation")) return href;
  url.searchParams.delete("invitation");
  return url.href;
}

/**
 * @param {import("../common/api.js").Request} request
 * @param {string} name of the study
 */
export function createStudyApi(request, name) {
  const path = `studies/${encodeURIComponent(name)}`;
  return {
    /** @returns {Promise<{status: "open" | "closed", rows: number, cols: number}>} */
    show: () => request(path),
    /**
     * @param {Record<string, string>} outside_ids
     * @param {string | null} invitation
     * @returns {Promise<Participant>}
     */
    join: (outside_ids, invitation) => request(`${path}/join`, { outside_ids, invitation }),
    /** @returns {Promise<Participant>} */
    me: () => request(`${path}/me`, undefined, 5000),
    /**
     * @param {string} version
     * @param {boolean} agree
     * @returns {Promise<Participant>}
     */
    consent: (version, agree) => request(`${path}/consent`, { version, agree }),
    /**
     * @param {Stage} from
     * @returns {Promise<Participant>}
     */
    advance: (from) => request(`${path}/advance`, { from }),
    /**
     * @param {number[]} answers
     * @returns {Promise<Participant>}
     */
    answers: (answers) => request(`${path}/answers`, { answers }),
    /** @returns {Promise<Participant>} */
    next: () => request(`${path}/next`, {}),
    /**
     * @param {string} episode
     * @param {number} step
     * @returns {Promise<Participant>}
     */
    giveUp: (episode, step) => request(`${path}/give-up`, { episode, step }),
    /**
     * Send the settings; the request outlives the page.
     * @param {Settings} settings
     * @param {AbortSignal} signal ends it
     * @returns {Promise<Participant>}
     */
    settings: (settings, signal) => request(`${path}/settings`, settings, undefined, { keepalive: true, signal }),
    /**
     * @param {string} code
     * @returns {Promise<Participant>}
     */
    supervise: (code) => request(`${path}/supervise`, { code }),
    /** @returns {Promise<Participant>} */
    withdraw: () => request(`${path}/withdraw`, {}),
    /**
     * @param {number} index
     * @param {import("./debrief.js").Shown} phase
     * @returns {Promise<Runs>}
     */
    terrain: (index, phase) => request(`${path}/debrief/${index}?phase=${phase}`),
    /**
     * @param {number} index
     * @param {import("./debrief.js").Shown} phase
     * @returns {Promise<import("../common/losses.js").Regret>}
     */
    losses: (index, phase) => request(`${path}/debrief/${index}/regret?phase=${phase}`, undefined, 120_000),
  };
}
