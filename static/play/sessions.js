// @ts-check
// Sessions and episodes: which to open, when the next begins, what follows the end of a ranked one.
import { ApiError } from "../common/api.js";

/**
 * @typedef {import("../common/game_state.js").Mode} Mode
 * @typedef {import("./terrain_dialog.js").Wish} Wish
 * @typedef {import("../common/game_state.js").Event} Event
 */

/**
 * Return the body of POST api/sessions.
 * @param {Mode} mode
 * @param {Wish} wish
 */
export function sessionWish(mode, { level, size, seed, rival, player }) {
  const terrain = seed === null ? { level, size } : { level, size, seed };
  if (mode === "ranked") return { ...terrain, player: "human" };
  return { ...terrain, player: mode === "watch" ? player : "human", rival };
}

/**
 * Return the session named in the address, if any.
 * @param {string} hash
 */
export function sessionInHash(hash) {
  return /^#s=([\w-]{4,128})$/.exec(hash)?.[1] ?? null;
}

/**
 * @param {{api: ReturnType<import("../common/api.js").createApi>, wish: () => Wish, dispatch: (event: Event) => void,
 *   remember: (session: string) => void, recall: () => string | null, onBegun: (about: import("../common/messages.js").About) => void}} how
 */
export function createSessions({ api, wish, dispatch, remember, recall, onBegun }) {
  let isBusy = false;
  /** @type {string | null} */
  let replayedEpisode = null;

  /**
   * Make one request at a time, and show its failure as a sentence.
   * @template T
   * @param {() => Promise<T>} work
   */
  async function once(work) {
    if (isBusy) return;
    isBusy = true;
    try {
      await work();
    } catch (error) {
      dispatch({ kind: "notice", text: error instanceof ApiError ? error.message : `Something went wrong on this page: ${error}` });
    }
    isBusy = false;
  }
  /** @param {import("../common/messages.js").About} about */
  function begin(about) {
    remember(about.session);
    dispatch({ kind: "begun", about });
    onBegun(about);
  }
  /**
   * @param {Mode} mode
   * @param {Wish} [chosen]
   */
  const start = (mode, chosen = wish()) => once(async () => begin(await api.createSession(sessionWish(mode, chosen))));
  return {
    start,
    /** Go on where a reload left off, or begin. */
    async restore() {
      const session = recall();
      if (!session) return start("practice");
      try {
        begin(await api.about(session));
      } catch (error) {
        if (error instanceof ApiError && error.status === 0) {
          dispatch({ kind: "link", link: "lost" });
          setTimeout(() => this.restore(), 1000);
          return;
        }
        dispatch({ kind: "notice", text: "The last game is no longer on the server; this is a new one.", tone: "note" });
        await start("practice");
      }
    },
    /**
     * Begin the next terrain of the same session.
     * @param {string} session
     * @param {number | null} seed
     */
    next: (session, seed) => once(async () => {
      const { level, size } = wish();
      begin(await api.nextEpisode(session, seed === null ? { level, size } : { level, size, seed }));
    }),
    /**
     * Begin the terrain just finished once more.
     * @param {string} session
     * @param {string} episode
     */
    again: (session, episode) => once(async () => {
      const { seed } = await api.episode(episode);
      const { level, size } = wish();
      begin(await api.nextEpisode(session, { level, size, seed }));
    }),
    /**
     * Show a policy on the terrain of a finished ranked episode, once unless asked again.
     * @param {import("../common/game_state.js").State} state
     * @param {boolean} [isAgain]
     */
    async replay({ player, level, size }, isAgain = false) {
      const episode = player?.frame.episode;
      if (!player || !episode || (replayedEpisode === episode && !isAgain)) return;
      replayedEpisode = episode;
      await once(async () => {
        const { seed } = await api.episode(episode);
        dispatch({ kind: "replay", about: await api.createSession({ level, size, seed, player: wish().rival, replays: player.session }) });
      });
    },
  };
}
