// @ts-check
// Leaving a ranked episode that is not finished: it counts as abandoned, so the page asks first.
import { put } from "../common/page.js";
import { many } from "../common/words.js";

/**
 * Return whether leaving the board would abandon an episode that counts.
 * @param {import("../common/game_state.js").State} state
 */
export function isUnfinished({ mode, counts, player }) {
  return mode === "ranked" && counts && player !== null && player.frame.step > 0 && player.frame.outcome === null;
}

/**
 * Return whether a wish asks for the very board that is being played: it goes on then.
 * @param {import("../common/game_state.js").State} state
 * @param {import("../common/game_state.js").Mode} wanted
 * @param {import("./terrain_dialog.js").Wish} wish
 */
export function isSameBoard({ mode, level, player }, wanted, wish) {
  const [rows, cols] = Array.isArray(wish.size) ? wish.size : [wish.size, wish.size];
  const frame = player?.frame;
  return wanted === mode && wish.seed === null && wish.level === level && frame?.rows === rows && frame.cols === cols;
}

/**
 * @param {HTMLDialogElement} dialog
 * @param {Window} view
 * @param {() => import("../common/game_state.js").State} state
 */
export function createLeaving(dialog, view, state) {
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
  return {
    /**
     * Do what leaves the board, once the player has agreed where that costs something.
     * @param {() => void} leave
     */
    ask(leave) {
      if (!isUnfinished(state())) return leave();
      work = leave;
      dialog.returnValue = "";
      const { step = 0, rows = 0, cols = 0 } = state().player?.frame ?? {};
      put(part("moves"), many(step, "move"));
      put(part("limit"), String(rows * cols));
      dialog.showModal();
    },
  };
}
