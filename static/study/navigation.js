// @ts-check
// Steps through the study's stages: one request at a time, each answered by the participant's stage and board; other tabs are notified.
import { ApiError } from "../common/api.js";

/**
 *   study       the study's API
 *   dispatch    what changes the state
 *   ids         ids of another site, from the address
 *   invitation  the token in the address, null without one
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
