// The four ways over a grid, and what the page knows of the ground ahead.

/** Rows down and columns right of a move, in the order of the codes of actions.
 * @type {Readonly<Record<Action, Cell>>} */
export const WAYS = Object.freeze({ north: [-1, 0], east: [0, 1], south: [1, 0], west: [0, -1] });
/** What the characters of a grid mean. */
export const CELL_STATES = Object.freeze({ "?": "unknown", ".": "free", "#": "obstacle", "@": "rover" });

/** @param {Cell} cell @param {Action} action @returns {Cell} the cell that a move leads to */
export const cellAfter = ([row, col], action) => [row + WAYS[action][0], col + WAYS[action][1]];

/** @param {string[]} grid @param {Cell} cell @returns the grid's character, undefined beyond its edge */
export const markAt = (grid, [row, col]) => grid[row]?.[col];

/** Return what the page knows of the cell that a move leads to, after the moves that still wait for their answer.
 * @param {Mars.Frame} frame the newest answer @param {readonly Action[]} waiting @param {Action} action @returns {Ground} */
export function ahead({ grid, position }, waiting, action) {
  const mark = markAt(grid, [...waiting, action].reduce(cellAfter, position));
  if (mark === undefined) return { stop: "Stopped before the edge" };
  if (mark === "#") return { stop: "Stopped before a rock" };
  return mark === "?" ? "unknown" : "free";
}
