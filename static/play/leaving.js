// @ts-check
// Leaving a ranked episode that is not finished: it counts as abandoned, so the page asks first; and the way to
// the live view of somebody else's board.
import { put } from "../common/page.js";
import { many } from "../common/words.js";

/** @param {GameState} state @returns whether leaving the board would abandon an episode that counts */
export function isUnfinished({ mode, counts, player }) {
  return mode === "ranked" && counts && player !== null && player.frame.step > 0 && player.frame.outcome === null;
}

/** Return whether a wish asks for the very board that is being played: it goes on then.
 * @param {GameState} state @param {Mode} wanted @param {Play.Wish} wish */
export function isSameBoard({ mode, level, player, task }, wanted, wish) {
  const [rows, cols] = Array.isArray(wish.size) ? wish.size : [wish.size, wish.size];
  const shape = player && task ? String(task.shape(player.frame)) : "";
  return wanted === mode && wish.seed === null && wish.level === level && shape === `${cols},${rows}`;
}

/**
 *   state  the newest state
 *   start  begins a board
 * @param {HTMLDialogElement} dialog @param {Window} view
 * @param {{state: () => GameState, start: (mode: Mode, wish: Play.Wish) => unknown}} how */
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
    const [cols, rows] = player && task ? task.shape(player.frame) : [0, 0];
    put(part("moves"), many(player?.frame.step ?? 0, "move"));
    put(part("limit"), String(rows * cols));
    dialog.showModal();
  }
  return {
    /** Begin a board, once the player has agreed where that abandons a ranked episode.
     * @param {Mode} mode @param {Play.Wish} wish */
    start(mode, wish) {
      if (!isUnfinished(state()) || isSameBoard(state(), mode, wish)) start(mode, wish);
      else ask(() => start(mode, wish));
    },
  };
}

/** Leave the playground for the live view of a board; ApiError 404 where there is none to watch, and nothing is left
 * then.
 * @param {string} id @param {(id: string) => Promise<unknown>} load asks the server for it
 * @param {{replace: (url: string) => void}} place the address of the page */
export async function showInstead(id, load, place) {
  await load(id);
  place.replace(`watch/${encodeURIComponent(id)}`);
}
