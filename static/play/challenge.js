// A challenge: the terrain of a finished episode once more, beside what was done on it. It is practice, and never counts.
import { ApiError } from "../common/api.js";

/** Where the episode that is played against another is kept, of this tab. */
const KEPT = "mars.challenge";

/** @param {string} hash @returns the episode that an address challenges to, or null */
export const challengedIn = (hash) => /^#challenge=([\w-]{4,64})$/.exec(hash)?.[1] ?? null;

/** @param {string} episode @returns the end of the address that challenges to it */
export const challengeHash = (episode) => `#challenge=${encodeURIComponent(episode)}`;

/** Return what opens challenges.
 *   storage  of this tab
 *   note     shows a sentence
 * @param {{api: Api, storage: Storage, dispatch: (event: GameEvent) => void, note: (text: string) => void}} how */
export function createChallenge({ api, storage, dispatch, note }) {
  let isNew = false;
  return {
    /** Return a board on the terrain of a finished episode, whose course the page then has as the opponent's; that board again
     * where this tab has begun it; null, with a note, where there is no such terrain.
     * @param {string} against the finished episode */
    async open(against) {
      try {
        const [{ level, rows, cols, seed }, { run }] = await Promise.all([api.episode(against), api.replay(against)]);
        if (seed === null) throw new ApiError("The terrain of this episode cannot be drawn again", 422);
        const kept = /** @type {{against?: string, own?: string}} */ (JSON.parse(storage.getItem(KEPT) ?? "{}"));
        const session = kept.against === against ? storage.getItem("mars.session") : null;
        const before = session ? await api.about(session).catch(() => null) : null;
        const about = before?.frame.episode === kept.own && before ? before
          : await api.createSession({ player: "human", level, size: rows === cols ? rows : [rows, cols], seed });
        const own = about.frame.episode;
        storage.setItem(KEPT, JSON.stringify({ against, own }));
        dispatch({ kind: "challenged", opponent: { episode: own, course: run.name === "You" ? { ...run, name: "Your replay" } : run } });
        isNew = true;
        return { about, isNewest: false };
      } catch (error) {
        if (!(error instanceof ApiError) || error.status === 0) throw error;
        note(`This challenge cannot be opened: ${error.message} This is a board of your own.`);
        return null;
      }
    },
    /** Return whether the board that is begun now is that of the challenge in the address, which then stays. */
    keepsAddress() {
      const keeps = isNew;
      isNew = false;
      return keeps;
    },
    /** Let the challenge begin anew at the next load. */
    forget: () => storage.removeItem(KEPT),
  };
}
