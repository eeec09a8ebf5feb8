// The four ways over a grid, and what the page knows of the ground ahead.
import { t } from "../../common/texts.js";

/** Rows down and columns right of a move, in the order of the codes of actions.
 * @type {Readonly<Record<Action, Cell>>} */
export const WAYS = Object.freeze({ north: [-1, 0], east: [0, 1], south: [1, 0], west: [0, -1] });
/** What the characters of a grid mean. */
export const CELL_STATES = Object.freeze({
  "?": t("mars.cell.unknown", "unknown"), ".": t("mars.cell.free", "free"), "#": t("mars.cell.obstacle", "obstacle"), "@": t("mars.cell.rover", "rover"),
});

/** @param {Cell} cell @param {Action} action @returns {Cell} the cell that a move leads to */
export const cellAfter = ([row, col], action) => [row + WAYS[action][0], col + WAYS[action][1]];

/** The lines of packed frames that were read before.
 * @type {WeakMap<Mars.Frame, string[]>} */
const UNPACKED = new WeakMap();

/** Return a frame's cells, a string a row; a packed frame has four cells in a character (docs/protocol.md).
 * @param {Mars.Frame} frame @returns {string[]} */
export function linesOf(frame) {
  if (!frame.packed) return frame.grid;
  const known = UNPACKED.get(frame);
  if (known) return known;
  const lines = frame.grid.map((row) => [...row].map(fourCells).join("").slice(0, frame.cols));
  const [row, col] = frame.position;
  lines[row] = `${lines[row].slice(0, col)}@${lines[row].slice(col + 1)}`;
  UNPACKED.set(frame, lines);
  return lines;
}

/** @param {string} character a number from 0 to 80, counted from `#` without the backslash @returns its four cells */
function fourCells(character) {
  const code = character.charCodeAt(0);
  const number = code - (code > 92 ? 36 : 35);
  return [27, 9, 3, 1].map((power) => "?.#"[Math.floor(number / power) % 3]).join("");
}

/** @param {string[]} grid @param {Cell} cell @returns the grid's character, undefined beyond its edge */
export const markAt = (grid, [row, col]) => grid[row]?.[col];

/** Return what the page knows of the cell that a move leads to, after the moves that still wait for their answer.
 * @param {Mars.Frame} frame the newest answer @param {readonly Action[]} waiting @param {Action} action @returns {Ground} */
export function ahead(frame, waiting, action) {
  const mark = markAt(linesOf(frame), [...waiting, action].reduce(cellAfter, frame.position));
  if (mark === undefined) return { stop: t("mars.stop.edge", "Stopped before the edge") };
  if (mark === "#") return { stop: t("mars.stop.rock", "Stopped before a rock") };
  return mark === "?" ? "unknown" : "free";
}
