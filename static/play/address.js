// The address of the playground: which way of playing it is, and the terrain that somebody chose; and the entries of the browser's
// history, each of which stands for a board. A ranked one holds no terrain.

/** @param {number | [number, number]} size @returns it as an address has it: "21", or "15x30" */
const sizeWord = (size) => (Array.isArray(size) ? size.join("x") : String(size));

/** Return the query of a board that somebody begins; "" for practice on any terrain.
 * @param {Mode} mode @param {Play.Wish | null} wish */
export function queryOf(mode, wish) {
  const query = new URLSearchParams();
  if (mode === "ranked" || mode === "watch") query.set("mode", mode);
  if (wish?.map) query.set("map", wish.map);
  else if (wish?.level && wish.size && (wish.level !== "random" || String(wish.size) !== "21" || wish.seed !== null)) {
    query.set("level", wish.level);
    query.set("size", sizeWord(wish.size));
    if (wish.seed !== null && mode !== "ranked") query.set("seed", String(wish.seed));
  }
  return query.toString() && `?${query}`;
}

/** @param {string | null} word @returns {number | [number, number] | null} the size of a terrain; null for none */
function sizeIn(word) {
  const [, rows, cols] = /^([0-9]{1,3})(?:x([0-9]{1,3}))?$/.exec(word ?? "") ?? [];
  if (!rows) return null;
  return cols ? [Number(rows), Number(cols)] : Number(rows);
}

/** @typedef {{mode: "practice" | "ranked" | "watch", wish: Partial<Play.Wish>}} Asked */

/** Return what a query asks for: a way of playing, and the parts of a wish that it names; null where it asks for nothing.
 * @param {string} search @returns {Asked | null} */
export function askedIn(search) {
  const query = new URLSearchParams(search);
  const named = query.get("mode");
  const mode = named === "ranked" || named === "watch" ? named : "practice";
  const [level, map, seed] = ["level", "map", "seed"].map((name) => query.get(name));
  if (mode === "practice" && named !== "practice" && !level && !map) return null;
  if (map) return { mode, wish: { level: "map", map } };
  if (!level) return { mode, wish: {} };
  const isSeed = mode !== "ranked" && /^[0-9]{1,16}$/.test(seed ?? "");
  return { mode, wish: { level, map: null, size: sizeIn(query.get("size")) ?? 21, seed: isSeed ? Number(seed) : null } };
}

/** @param {string} hash @returns the episode that an address challenges to, or null */
export const challengedIn = (hash) => /^#challenge=([\w-]{4,64})$/.exec(hash)?.[1] ?? null;

/** @param {string} episode @returns the end of the address that challenges to it */
export const challengeHash = (episode) => `#challenge=${encodeURIComponent(episode)}`;

/** @typedef {{episode: string, moves: number}} Tried */

/** @param {string} hash @returns {Tried | null} the finished episode that an address tries again, and after how many of its moves */
export function triedIn(hash) {
  const [, episode, moves] = /^#try=([\w-]{4,64}):([0-9]{1,5})$/.exec(hash) ?? [];
  return episode ? { episode, moves: Number(moves) } : null;
}

/** @param {string} episode @param {number} moves @returns the end of the address that tries it again */
export const tryHash = (episode, moves) => `#try=${encodeURIComponent(episode)}:${moves}`;

/** @typedef {{session: string, index: number}} Entry */

/** @param {unknown} state of the browser's history @returns {Entry | null} */
const entryOf = (state) => {
  const { session, index } = /** @type {Partial<Entry>} */ (state ?? {});
  return typeof session === "string" && typeof index === "number" ? { session, index } : null;
};

/**
 *   mustAsk  whether the board on the page may not go without asking
 *   ask      asks, and calls what is to follow where it may go
 *   show     shows the board of an entry
 * @param {Window} view @param {{mustAsk: () => boolean, ask: (leave: () => void) => void,
 *   show: (session: string) => void}} how */
export function createEntries(view, { mustAsk, ask, show }) {
  let here = entryOf(view.history.state) ?? { session: "", index: 0 };
  let isAllowed = false;
  let isUndone = false;
  view.addEventListener("popstate", ({ state }) => {
    const to = entryOf(state);
    if (isUndone || !to) {
      isUndone = false;
      return;
    }
    const back = here.index - to.index;
    if (to.session !== here.session && mustAsk() && !isAllowed) {
      isUndone = true;
      view.history.go(back);
      return ask(() => {
        isAllowed = true;
        view.history.go(-back);
      });
    }
    isAllowed = false;
    const isOther = to.session !== here.session;
    here = to;
    if (isOther) show(to.session);
  });
  view.addEventListener("hashchange", () => { if (!entryOf(view.history.state)) view.location.reload(); }); // a link pasted over another
  return {
    /** The board that this entry stands for, "" for none yet. */
    session: () => here.session,
    /** Put a board's address there: into this entry where it is the same board or the entry has none, else into a new one.
     * @param {string} session @param {string} address */
    place(session, address) {
      const isNew = here.session !== "" && here.session !== session;
      here = { session, index: here.index + Number(isNew) };
      if (isNew) view.history.pushState(here, "", address);
      else view.history.replaceState(here, "", address);
    },
    /** Forget the board of this entry, which is gone. */
    clear() { here = { ...here, session: "" }; },
  };
}
