// The study's API, and the types of its answers.
import { ApiError, request, withTask } from "../common/api.js";

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

/** @param {string} name of the study */
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
    /** @returns {Promise<{status: "open" | "closed", task: {name: string}}>} */
    show: () => request(path),
    /** @param {Record<string, string>} outside_ids @param {string | null} invitation */
    join: (outside_ids, invitation) => ask("join", { outside_ids, invitation }),
    me: () => ask("me", undefined, 5000),
    /** @param {string} version @param {boolean} agree */
    consent: (version, agree) => ask("consent", { version, agree }),
    /** @param {Study.Stage} from */
    advance: (from) => ask("advance", { from }),
    /** @param {number[]} answers */
    answers: (answers) => ask("answers", { answers }),
    next: () => ask("next", {}),
    /** @param {string} episode @param {number} step */
    giveUp: (episode, step) => ask("give-up", { episode, step }),
    /** Send the settings; the request outlives the page.
     * @param {Study.Settings} settings @param {AbortSignal} signal ends it */
    settings: (settings, signal) => ask("settings", settings, undefined, { keepalive: true, signal }),
    /** @param {string} code */
    supervise: (code) => ask("supervise", { code }),
    withdraw: () => ask("withdraw", {}),
    /** @param {number} index @param {Study.Shown} phase @returns {Promise<Study.Runs>} */
    terrain: (index, phase) => request(`${path}/debrief/${index}?phase=${phase}`),
    /** @param {number} index @param {Study.Shown} phase @returns {Promise<Regret>} */
    losses: (index, phase) => request(`${path}/debrief/${index}/regret?phase=${phase}`, undefined, 120_000),
  };
}

/**
 *   channel     to other tabs of this study; null where there is none
 * @param {{study: ReturnType<import("./api.js").createStudyApi>, dispatch: (event: Study.Event) => void,
 *   ids: Record<string, string>, invitation: string | null, channel: BroadcastChannel | null,
 *   onJoined: (participant: Study.Participant) => void}} how */
export function createNavigation({ study, dispatch, ids, invitation, channel, onJoined }) {
  /** @type {Promise<unknown>} */
  let queue = Promise.resolve();
  let isBusy = false;

  /** @param {() => Promise<void>} work @returns {Promise<void>} */
  function inTurn(work) {
    const done = queue.then(work);
    queue = done.catch(() => {});
    return /** @type {Promise<void>} */ (done);
  }
  /** @param {Study.Participant} participant */
  const arrive = (participant) => dispatch({ kind: "participant", participant });
  const refresh = () => inTurn(async () => {
    try {
      arrive(await study.me());
    } catch (error) {
      if (error instanceof ApiError && error.status === 0) dispatch({ kind: "link", link: "lost" });
    }
  });
  /** Show why a request was refused. A 409 means that another tab was quicker, or the study closed: what holds now is
   * shown, and the server's sentence if nothing moved.
   * @param {unknown} error @param {string | undefined} stage */
  async function refused(error, stage) {
    if (!(error instanceof ApiError)) return dispatch({ kind: "notice", text: `Something went wrong on this page: ${error}` });
    if (error.status === 0) dispatch({ kind: "link", link: "lost" });
    const participant = error.status === 409 ? await study.me().catch(() => null) : null;
    if (participant) arrive(participant);
    if (!participant || (participant.stage === stage && !participant.note)) dispatch({ kind: "notice", text: error.message });
  }
  /** @param {() => Promise<Study.Participant>} ask @param {string} [stage] the step is taken from */
  const step = (ask, stage) => inTurn(async () => {
    try {
      arrive(await ask());
      channel?.postMessage("moved");
    } catch (error) {
      await refused(error, stage);
    }
  });
  return {
    refresh,
    /** Return whether a request waits for its answer: another press of its button would be one too many. */
    isBusy: () => isBusy,
    /** Make a request that moves the participant on, unless one is being answered.
     * @param {() => Promise<Study.Participant>} ask @param {string} [stage] the step is taken from */
    async go(ask, stage) {
      if (isBusy) return;
      isBusy = true;
      await step(ask, stage);
      isBusy = false;
    },
    /** Make a request that was confirmed in a dialog: it waits for the one that is being answered, and is never dropped. */
    step,
    /** Join the study or go on in it; try again while there is no server. */
    async join() {
      try {
        const participant = await study.join(ids, invitation);
        onJoined(participant);
        arrive(participant);
      } catch (error) {
        const { status, message } = /** @type {ApiError} */ (error);
        if (status === 0) {
          dispatch({ kind: "link", link: "lost" });
          setTimeout(() => this.join(), 1000);
          return;
        }
        const about = status === 409 ? await study.show().catch(() => null) : null;
        const participant = about?.status === "closed" ? await study.me().catch(() => null) : null;
        if (participant) arrive(participant);
        else dispatch({ kind: "problem", text: message ?? String(error) });
      }
    },
  };
}
