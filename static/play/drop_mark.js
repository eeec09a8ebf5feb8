// @ts-check
// What became of presses that make no move: a short mark on the board, and one polite sentence once the burst is over.
import { create, put } from "../common/page.js";
import { many } from "../common/words.js";

const SHOWN_MS = 2600;
const QUIET_MS = 500;
/** @type {Readonly<Record<Play.Reason, string>>} */
const CAUSES = Object.freeze({
  rock: "Stopped before a rock", edge: "Stopped before the edge", ended: "The episode has ended", lost: "No connection",
  refused: "The board had changed meanwhile", full: "Too many presses at once",
});

/** Return the sentence about presses that make no move.
 * @param {Play.Reason} reason @param {number} count 0 where a held key has stopped */
export const droppedText = (reason, count) => (count === 0 ? `${CAUSES[reason]}.` : `${CAUSES[reason]}: ${many(count, "press", "presses")} dropped.`);

/** Return what the mark shows after more presses were dropped: while it is shown, those of one reason are added up, and
 * those of one burst, which may be too long for the grid first and then meet a rock that comes into sight.
 * @param {{reason: Play.Reason, count: number} | null} shown @param {Play.Reason} reason @param {number} count */
export function addedUp(shown, reason, count) {
  const isSame = shown && (shown.reason === reason || (isStop(shown.reason) && isStop(reason)));
  return { reason, count: (isSame ? shown.count : 0) + count };
}
/** @param {Play.Reason} reason */
const isStop = (reason) => reason === "rock" || reason === "edge";

/** @param {HTMLElement} board gets the mark @param {(text: string) => void} announce to screen readers, politely */
export function createDropMark(board, announce) {
  const mark = create("p", [], { class: "drop-mark", "data-testid": "dropped", "aria-hidden": "true" });
  mark.hidden = true;
  board.append(mark);
  /** @type {{reason: Play.Reason, count: number} | null} */
  let shown = null;
  let hiding = 0;
  let saying = 0;
  return {
    /** @param {Play.Reason} reason @param {number} count */
    show(reason, count) {
      shown = addedUp(shown, reason, count);
      const text = droppedText(shown.reason, shown.count);
      put(mark, text);
      mark.dataset.reason = reason;
      mark.hidden = false;
      clearTimeout(hiding);
      clearTimeout(saying);
      saying = setTimeout(() => announce(text), QUIET_MS);
      hiding = setTimeout(() => { mark.hidden = true; shown = null; }, SHOWN_MS);
    },
  };
}
