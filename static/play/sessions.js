// @ts-check
// Sessions and episodes: which to open, when the next begins, what follows the end of a ranked one.
import { ApiError } from "../common/api.js";

/** @param {Pick<Play.Wish, "level" | "map" | "size" | "seed">} wish */
const terrainOf = ({ level, map, size, seed }) => (map ? { map } : seed === null ? { level, size } : { level, size, seed });

/** @param {Mode} mode @param {Play.Wish} wish @returns the body of POST api/sessions */
export function sessionWish(mode, { rival, player, ...terrainWish }) {
  const terrain = terrainOf(terrainWish);
  if (mode === "ranked") return { ...terrain, player: "human" };
  return { ...terrain, player: mode === "watch" ? player : "human", rival };
}

/** Return the id that an address lets anybody watch, if any: a board's or an episode's.
 * @param {string} hash */
export function watchedInHash(hash) {
  return /^#watch=([\w-]{4,64})$/.exec(hash)?.[1] ?? null;
}

/**
 *   hash      of the address
 *   storage   of this tab: its session, and the id for watching that it put into the address
 *   setHash   puts the shareable link into the address
 *   watch     shows somebody else's board; ApiError 404 when there is none
 * @param {{api: ReturnType<import("../common/api.js").createApi>, wish: () => Play.Wish,
 *   dispatch: (event: GameEvent) => void, hash: () => string, storage: Storage, setHash: (hash: string) => void,
 *   watch: (id: string) => Promise<void>, onBegun: (about: About) => void}} how */
export function createSessions({ api, wish, dispatch, hash, storage, setHash, watch, onBegun }) {
  let isBusy = false;
  /** @type {string | null} */
  let replayedEpisode = null;

  /** Do something, and show its failure as a sentence.
   * @template T @param {() => Promise<T>} work */
  async function attempt(work) {
    try {
      await work();
    } catch (error) {
      dispatch({ kind: "notice", text: error instanceof ApiError ? error.message : `Something went wrong on this page: ${error}` });
    }
  }
  /** Do one thing at a time that the player asked for.
   * @template T @param {() => Promise<T>} work */
  async function once(work) {
    if (isBusy) return;
    isBusy = true;
    await attempt(work);
    isBusy = false;
  }
  /** @param {About} about */
  function begin(about) {
    storage.setItem("mars.session", about.session);
    if (about.watch) {
      storage.setItem("mars.watch", about.watch);
      setHash(`#watch=${about.watch}`);
    }
    dispatch({ kind: "begun", about });
    onBegun(about);
  }
  const note = (/** @type {string} */ text) => dispatch({ kind: "notice", text, tone: "note" });
  /** @template T @param {Promise<T>} asked @returns the answer; null where it is that there is no such thing here */
  const orNull = (asked) => asked.catch((error) => {
    if (error instanceof ApiError && error.status === 404) return null;
    throw error;
  });
  /** Return the board that the address or this tab stands for; undefined when somebody else's board is watched instead. */
  async function findOwn() {
    const watched = watchedInHash(hash());
    const session = storage.getItem("mars.session");
    if (watched && watched !== storage.getItem("mars.watch")) {
      const own = await api.mySession({ watch: watched });
      if (own) return own;
      if (await orNull(watch(watched).then(() => true))) return undefined;
      note("This link leads to no episode that can be watched; this is a board of your own.");
    }
    return session ? orNull(api.about(session)) : null;
  }
  /** @param {Mode} mode @param {Play.Wish} [chosen] */
  const start = (mode, chosen = wish()) => once(async () => begin(await api.createSession(sessionWish(mode, chosen))));
  return {
    start,
    /** Go on where a reload left off, with the player's board of another tab, or begin; or watch what the address names. */
    async restore() {
      try {
        const own = await findOwn();
        if (own === undefined) return;
        await this.resume(own);
      } catch (error) {
        // never a new board for want of an answer: it would abandon a ranked episode that waits
        if (!(error instanceof ApiError)) throw error;
        if (error.status !== 0) dispatch({ kind: "notice", text: error.message });
        dispatch({ kind: "link", link: "lost" });
        setTimeout(() => this.restore(), 1000);
      }
    },
    /** Go on with a board of one's own, the newest unless another is given, or begin one.
     * @param {About | null} [found] */
    async resume(found = null) {
      const about = found ?? await api.mySession();
      if (!about) return start("practice");
      begin(about);
      if (!found && about.counts && about.frame.step > 0 && !about.frame.outcome) note("You are back in your ranked episode, where you left it.");
    },
    /** Begin the next terrain of the same session.
     * @param {string} session @param {number | null} seed */
    next: (session, seed) => once(async () => {
      begin(await api.nextEpisode(session, terrainOf({ ...wish(), seed })));
    }),
    /** Begin the terrain just finished once more.
     * @param {string} session @param {string} episode */
    again: (session, episode) => once(async () => {
      const { seed } = await api.episode(episode);
      const { level, size } = wish();
      begin(await api.nextEpisode(session, seed === null ? {} : { level, size, seed })); // a map stays when nothing is said
    }),
    /** Begin the terrain of the player's finished episode once more, in practice, and make its first moves again.
     * @param {GameState} state @param {number} moves */
    tryFrom: ({ mode, player }, moves) => once(async () => {
      if (!player) return;
      const { level, rows, cols, seed, actions } = await api.episode(player.frame.episode);
      const terrain = { level, size: rows === cols ? rows : /** @type {[number, number]} */ ([rows, cols]), seed };
      const about = await (mode === "practice" ? api.nextEpisode(player.session, terrain)
        : api.createSession({ ...terrain, player: "human", rival: wish().rival }));
      begin(about);
      for (const [step, action] of actions.slice(0, moves).entries()) await api.act(about.session, { episode: about.frame.episode, step, action });
      note(`Practice from move ${moves + 1}: the moves before it are made again, and the next one is yours. Nothing counts here.`);
    }),
    /** Show a policy on the terrain of a finished ranked episode, once unless asked again. The player need not wait for
     * it.
     * @param {GameState} state @param {boolean} [isAgain] */
    async replay({ player, level, size }, isAgain = false) {
      const episode = player?.frame.episode;
      if (!player || !episode || (replayedEpisode === episode && !isAgain)) return;
      replayedEpisode = episode;
      await attempt(async () => {
        const { seed } = await api.episode(episode);
        const terrain = seed === null ? {} : { level, size, seed };
        dispatch({ kind: "replay", episode, about: await api.createSession({ ...terrain, player: wish().rival, replays: player.session }) });
      });
    },
  };
}
