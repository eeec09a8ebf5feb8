// @ts-check
// The study's API, and the types of its answers.

/** @param {string} pathname @returns the study's name in the page's address */
export function studyName(pathname) {
  return decodeURIComponent(/\/study\/([^/]*)\/?$/.exec(pathname)?.[1] ?? "");
}

/** Return the ids that another site put into the address: each name once, no empty ones; the server knows which it
 * wants.
 * @param {string} search */
export function outsideIds(search) {
  const found = [...new URLSearchParams(search)].filter(([name, value]) => name && value && name.length <= 64 && value.length <= 200);
  return Object.fromEntries(found.slice(0, 20));
}

/** @param {string} search @returns the invitation's token in the page's address; null without one */
export const invitationIn = (search) => new URLSearchParams(search).get("invitation") || null;

/** Return the page's address without the invitation's token: whoever copies it afterwards hands on nothing.
 * @param {string} href */
export function withoutInvitation(href) {
  const url = new URL(href);
  if (!url.searchParams.has("invitation")) return href;
  url.searchParams.delete("invitation");
  return url.href;
}

/** @param {ApiRequest} request @param {string} name of the study */
export function createStudyApi(request, name) {
  const path = `studies/${encodeURIComponent(name)}`;
  return {
    /** @returns {Promise<{status: "open" | "closed", task: {name: string}}>} */
    show: () => request(path),
    /** @param {Record<string, string>} outside_ids @param {string | null} invitation
     * @returns {Promise<Study.Participant>} */
    join: (outside_ids, invitation) => request(`${path}/join`, { outside_ids, invitation }),
    /** @returns {Promise<Study.Participant>} */
    me: () => request(`${path}/me`, undefined, 5000),
    /** @param {string} version @param {boolean} agree @returns {Promise<Study.Participant>} */
    consent: (version, agree) => request(`${path}/consent`, { version, agree }),
    /** @param {Study.Stage} from @returns {Promise<Study.Participant>} */
    advance: (from) => request(`${path}/advance`, { from }),
    /** @param {number[]} answers @returns {Promise<Study.Participant>} */
    answers: (answers) => request(`${path}/answers`, { answers }),
    /** @returns {Promise<Study.Participant>} */
    next: () => request(`${path}/next`, {}),
    /** @param {string} episode @param {number} step @returns {Promise<Study.Participant>} */
    giveUp: (episode, step) => request(`${path}/give-up`, { episode, step }),
    /** Send the settings; the request outlives the page.
     * @param {Study.Settings} settings @param {AbortSignal} signal ends it @returns {Promise<Study.Participant>} */
    settings: (settings, signal) => request(`${path}/settings`, settings, undefined, { keepalive: true, signal }),
    /** @param {string} code @returns {Promise<Study.Participant>} */
    supervise: (code) => request(`${path}/supervise`, { code }),
    /** @returns {Promise<Study.Participant>} */
    withdraw: () => request(`${path}/withdraw`, {}),
    /** @param {number} index @param {Study.Shown} phase @returns {Promise<Study.Runs>} */
    terrain: (index, phase) => request(`${path}/debrief/${index}?phase=${phase}`),
    /** @param {number} index @param {Study.Shown} phase @returns {Promise<Regret>} */
    losses: (index, phase) => request(`${path}/debrief/${index}/regret?phase=${phase}`, undefined, 120_000),
  };
}
