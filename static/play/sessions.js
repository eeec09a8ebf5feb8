// Sessions and episodes: which to open, when the next begins, what follows the end of a ranked one.
import { ApiError } from "../common/api.js";
import { put } from "../common/page.js";
import { many } from "../common/words.js";
import { TRIED } from "../common/storage.js";
import { challengedIn, challengeHash, queryOf, triedIn } from "./address.js";

/** @param {Play.Wish | null} wish null where the task leaves nothing to be chosen @param {number | null} [seed] */
function terrainOf(wish, seed = wish?.seed ?? null) {
  const drawn = seed === null ? {} : { seed };
  return !wish ? drawn : wish.map ? { map: wish.map } : { level: wish.level, size: wish.size, ...drawn };
}

/** @param {Mode} mode @param {Play.Wish | null} wish @returns the body of POST api/sessions */
export function sessionWish(mode, wish) {
  const terrain = terrainOf(wish);
  if (mode === "ranked" || !wish) return { ...terrain, player: "human" };
  return { ...terrain, player: mode === "watch" ? wish.player : "human", rival: wish.rival };
}

/** Return the way of playing that begins on a terrain: one that is chosen, by its seed or as a map, never counts.
 * @param {Mode} mode that is on the page now @param {Play.Wish} wish @returns {Mode} */
export function modeOn(mode, { seed, map }) {
  if (mode === "watch") return mode;
  return mode === "ranked" && seed === null && !map ? "ranked" : "practice";
}

/** Return the id that an address lets anybody watch, if any: a board's or an episode's.
 * @param {string} hash */
export const watchedInHash = (hash) => /^#watch=([\w-]{4,64})$/.exec(hash)?.[1] ?? null;

/** Ask until the server answers: never a new board for want of an answer, which would abandon a ranked episode that waits.
 * @template T @param {() => Promise<T>} ask @param {(error: ApiError) => void} onFailure before it is asked again */
export async function patiently(ask, onFailure) {
  for (;;) {
    try {
      return await ask();
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      onFailure(error);
      await new Promise((done) => setTimeout(done, 1000));
    }
  }
}

/** @template T @param {Promise<T>} asked @returns the answer; null where it is that there is no such thing here */
const orNull = (asked) => asked.catch((error) => {
  if (error instanceof ApiError && error.status === 404) return null;
  throw error;
});

/** Return the board that the address or this tab stands for, else the newest of this browser's player, if any;
 * undefined when somebody else's board is watched instead. A link that challenges stands for the board on which this tab has
 * taken it up, else for a new one, as does a query that asks for a way of playing or a terrain.
 *   entry     the board of this entry of the history, "" for none
 *   asked     what the query asks for
 *   start     begins what a query asks for
 *   storage   of this tab: its session, and the id for watching that it put into the address
 *   watch     shows somebody else's board; ApiError 404 when there is none
 * @param {{api: Api, hash: string, entry: string, asked: import("./address.js").Asked | null,
 *   start: (asked: import("./address.js").Asked) => Promise<About>, storage: Pick<Store, "getItem" | "setItem">,
 *   watch: (id: string) => Promise<void>, note: (text: string) => void}} how
 * @returns {Promise<Found | undefined>} */
export async function findBoard({ api, hash, entry, asked, start, storage, watch, note }) {
  const watched = watchedInHash(hash);
  const challenged = challengedIn(hash);
  const before = entry || (storage.getItem("humanplay.session") ?? "");
  const session = /^[\w-]{1,128}$/.test(before) ? before : null; // the browser may hold anything
  if (watched && watched !== storage.getItem("humanplay.watch")) {
    const about = await api.mySession({ watch: watched });
    if (about) return { about, isNewest: false };
    if (await orNull(watch(watched).then(() => true))) return undefined;
    note("This link leads to no episode that can be watched; this is a board of your own.");
  }
  const about = session ? await orNull(api.about(session)) : null;
  if (challenged && about?.challenges !== challenged) {
    try {
      return { about: await api.createSession({ challenges: challenged }), isNewest: false };
    } catch (error) {
      if (!(error instanceof ApiError) || error.status === 0) throw error;
      note(`This challenge cannot be opened: ${error.message} This is a board of your own.`);
    }
  }
  const tried = entry ? null : triedIn(hash);
  const isNew = asked && !entry && !challenged && !isAsked(about, asked);
  if (tried || isNew) {
    const open = await api.mySession(); // an address drops no ranked episode
    if (open && isUnfinished({ mode: open.kind, counts: open.counts, player: open })) return { about: open, isNewest: true };
  }
  if (tried) return { about: null, isNewest: false, tried };
  if (isNew) {
    try {
      return { about: await start(asked), isNewest: false, isAsked: true };
    } catch (error) {
      if (!(error instanceof ApiError) || error.status === 0 || error.status === 503) throw error;
      note(`What this address asks for cannot be played: ${error.message}`);
    }
  }
  return about ? { about, isNewest: false, isAsked: Boolean(entry) } : { about: await api.mySession(), isNewest: true };
}

/** Return what is to be beaten on a board: the course of the episode that it challenges; null on any other board.
 * @param {Api} api @param {About} about @returns {Promise<Opponent | null>} */
async function opponentOf(api, { challenges, frame }) {
  if (!challenges) return null;
  const { run } = await api.replay(challenges);
  return { episode: frame.episode, course: run.name === "You" ? { ...run, name: "Your replay" } : run };
}

/** A board, whether it is the newest of the player's, and whether the address has asked for it; or what is tried again.
 * @typedef {{about: About | null, isNewest: boolean, isAsked?: boolean, tried?: import("./address.js").Tried}} Found */

/** Return whether a board is what an address asks for.
 * @param {About | null} about @param {import("./address.js").Asked} asked */
const isAsked = (about, { mode, wish }) => about?.kind === mode && !Object.keys(wish).length;

/** @param {About} about @returns {Play.Wish} the terrain of a board, without its seed */
const wishOf = ({ level, map, size }) => ({ level, map, size: size ?? undefined, seed: null, rival: "", player: "" });

/**
 *   place   puts the address of a board into the browser's history; a query of null stays as it is
 * @param {{api: Api, wish: () => Play.Wish | null, storage: Pick<Store, "getItem" | "setItem">,
 *   dispatch: (event: GameEvent) => void, place: (session: string, query: string | null, hash: string) => void, onBegun: (about: About) => void}} how */
export function createSessions({ api, wish, dispatch, storage, place, onBegun }) {
  let isBusy = false;
  /** The episode whose first moves are made again, and how many. */
  let again = { episode: "", moves: 0 };
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
    let text = "";
    const late = setTimeout(async () => {
      const why = (await api.health().catch(() => null))?.getting_ready;
      if (!why || !isBusy) return;
      text = `${why[0]?.toUpperCase()}${why.slice(1)}.`;
      dispatch({ kind: "notice", text, tone: "note", role: "player" });
    }, 1000);
    await attempt(work);
    clearTimeout(late);
    if (text) dispatch({ kind: "dismiss", text });
    isBusy = false;
  }
  const note = (/** @type {string} */ text) => dispatch({ kind: "notice", text, tone: "note" });
  /** Show a board, under the address of the terrain that was wished for; undefined keeps the address.
   * @param {About} about @param {Play.Wish | null} [chosen] */
  async function begin(about, chosen) {
    const opponent = await opponentOf(api, about).catch((error) => error);
    storage.setItem("humanplay.session", about.session);
    if (about.watch) storage.setItem("humanplay.watch", about.watch);
    dispatch({ kind: "begun", about });
    const hash = about.challenges ? challengeHash(about.challenges) : about.watch ? `#watch=${about.watch}` : "";
    place(about.session, chosen === undefined ? null : queryOf(about.kind, chosen), hash);
    if (opponent instanceof Error) note(`What is to be beaten here cannot be shown: ${opponent.message}`);
    else if (opponent) dispatch({ kind: "challenged", opponent });
    onBegun(about);
  }
  /** @param {Mode} mode @param {Play.Wish | null} [chosen] */
  const start = (mode, chosen = wish()) => once(async () => begin(await api.createSession(sessionWish(mode, chosen)), chosen));
  /** Begin the terrain of the player's finished episode once more, in practice, and make its first moves again.
   * @param {import("./address.js").Tried} tried @param {string | null} [session] of a board in practice; null opens one
   * @returns whether it has begun */
  async function tryFrom({ episode: finished, moves }, session = null) {
    let hasBegun = false;
    await once(async () => {
      const { level, rows, cols, seed, actions, outcome, steps } = await api.episode(finished);
      if (seed === null) throw new ApiError("This terrain was not drawn from a seed, so it cannot be tried again.", 422);
      const terrain = { level, size: rows === cols ? rows : /** @type {[number, number]} */ ([rows, cols]), seed };
      const about = await (session ? api.nextEpisode(session, terrain)
        : api.createSession({ ...terrain, player: "human", rival: wish()?.rival }));
      const { frame: { episode } } = about;
      const before = about.task.successes.includes(outcome) ? steps : null;
      storage.setItem(TRIED, JSON.stringify({ episode, move: moves + 1, before }));
      again = { episode, moves };
      hasBegun = true;
      await begin(about, wishOf(about));
      for (const [step, action] of actions.slice(0, moves).entries()) {
        await api.act(about.session, { episode, step, action }).catch((error) => { again.moves = 0; throw error; });
      }
      note(`Practice from move ${moves + 1}: the moves before it are made again, and the next one is yours. Nothing counts here.`);
    });
    return hasBegun;
  }
  return {
    start,
    /** Take up a challenge, once more where it was taken up before.
     * @param {string} challenges the finished episode */
    challenge: (challenges) => once(async () => begin(await api.createSession({ challenges }), null)),
    /** Go on with a board of one's own, or begin one.
     * @param {Found} found */
    async resume({ about, isNewest, isAsked: isWanted, tried }) {
      if (tried && await tryFrom(tried)) return undefined;
      if (!about) return start(wish()?.level ? "practice" : "ranked");
      await begin(about, isWanted ? undefined : wishOf(about));
      if (isNewest && about.counts && about.frame.step > 0 && !about.frame.outcome) note("You are back in your ranked episode, where you left it.");
    },
    /** Go back to the board of an entry of the history.
     * @param {string} session @param {() => void} onGone */
    goBack: (session, onGone) => once(async () => {
      const about = await orNull(api.about(session));
      if (about) await begin(about);
      else onGone();
    }),
    /** Begin the next terrain of the same session.
     * @param {string} session @param {number | null} seed */
    next: (session, seed) => once(async () => {
      const chosen = wish();
      await begin(await api.nextEpisode(session, terrainOf(chosen, seed)), chosen && { ...chosen, seed });
    }),
    /** Begin the terrain just finished once more.
     * @param {string} session @param {string} episode */
    again: (session, episode) => once(async () => {
      const { seed } = await api.episode(episode);
      const chosen = wish();
      await begin(await api.nextEpisode(session, seed === null ? {} : terrainOf(chosen && { ...chosen, map: null }, seed))); // a map stays when nothing is said
    }),
    tryFrom,
    /** @param {Frame} frame @returns whether first moves of its episode are still to be made again */
    isMadeAgain: ({ episode, step }) => episode === again.episode && step < again.moves,
    /** Show a policy on the terrain of a finished ranked episode, once unless asked again. The player need not wait for it.
     * @param {GameState} state @param {boolean} [isAgain] */
    async replay({ player, level, size }, isAgain = false) {
      const episode = player?.frame.episode;
      if (!player || !episode || (replayedEpisode === episode && !isAgain)) return;
      replayedEpisode = episode;
      await attempt(async () => {
        const { seed } = await api.episode(episode);
        const terrain = seed === null || !wish()?.level ? {} : { level, size, seed };
        dispatch({ kind: "replay", episode, about: await api.createSession({ ...terrain, player: wish()?.rival, replays: player.session }) });
      });
    },
  };
}

/** @param {GameState["player"] | About} board @returns whether it is between its first move and its end */
const isInProgress = (board) => board !== null && board.frame.step > 0 && board.frame.outcome === null;

/** Return whether leaving the board would abandon an episode that counts.
 * @param {{mode: Mode, counts: boolean, player: GameState["player"] | About}} state */
export const isUnfinished = ({ mode, counts, player }) => mode === "ranked" && counts && isInProgress(player);

/** @param {GameState} state @returns whether somebody is under way on a terrain, which is not to go unasked */
export const isUnderWay = ({ mode, counts, player }) => isInProgress(player) && (mode === "ranked" ? counts : mode === "practice" || mode === "challenge");

/** Return whether a wish asks for the very board that is being played: it goes on then.
 * @param {GameState} state @param {Mode} wanted @param {Play.Wish | null} wish */
export function isSameBoard({ mode, level, player, task }, wanted, wish) {
  if (!wish?.level) return wanted === mode;
  const [rows, cols] = Array.isArray(wish.size) ? wish.size : [wish.size, wish.size];
  const shape = player && task ? String(task.shape(player.frame)) : "";
  return wanted === mode && wish.seed === null && wish.level === level && shape === `${cols},${rows}`;
}

/** @param {HTMLDialogElement} dialog @param {Window} view
 * @param {{state: () => GameState, start: (mode: Mode, wish: Play.Wish | null) => unknown}} how */
export function createLeaving(dialog, view, { state, start }) {
  const part = (/** @type {string} */ name) => /** @type {HTMLElement} */ (dialog.querySelector(`[data-part=${name}]`));
  /** @type {(() => void) | null} */
  let work = null;
  dialog.addEventListener("close", () => {
    const leave = work;
    work = null;
    if (dialog.returnValue === "leave") leave?.();
  });
  view.addEventListener("beforeunload", (event) => {
    if (isUnfinished(state())) event.preventDefault();
  });
  /** @param {() => void} leave */
  function ask(leave) {
    work = leave;
    dialog.returnValue = "";
    const { player, task } = state();
    const counts = isUnfinished(state());
    put(part("title"), counts ? "This ranked episode is not finished" : `This ${task?.round} is not finished`);
    put(part("moves"), many(player?.frame.step ?? 0, "move"));
    part("counted").hidden = !counts;
    part("practice").hidden = counts;
    dialog.showModal();
  }
  return {
    ask,
    /** Begin a board, once the player has agreed where one is under way.
     * @param {Mode} mode @param {Play.Wish | null} wish */
    start(mode, wish) {
      const { mode: now } = state();
      const goesOn = now === "ranked" && isSameBoard(state(), mode, wish); // the server answers with the open one
      if (!isUnderWay(state()) || goesOn) start(mode, wish);
      else ask(() => start(mode, wish));
    },
  };
}

/** Leave the playground for the live view of a board; ApiError 404 where there is none to watch, and nothing is left then.
 * @param {string} id @param {(id: string) => Promise<unknown>} load asks the server for it @param {{replace: (url: string)
 * => void}} place the address of the page */
export async function showInstead(id, load, place) {
  await load(id);
  place.replace(`watch/${encodeURIComponent(id)}`);
}
