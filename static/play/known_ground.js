// @ts-check
// What the page can know of the cell that a move leads to: the grid that the rover has seen, and nothing else.

/** @type {Readonly<Record<Action, Cell>>} */
const STEPS = Object.freeze({ north: [-1, 0], east: [0, 1], south: [1, 0], west: [0, -1] });

/** Return the cell that the rover stands on once it has made some moves from the frame on, if none of them ends the
 * episode.
 * @param {Frame} frame @param {readonly Action[]} actions @returns {Cell} */
export function cellAfter(frame, actions) {
  let [row, col] = frame.position;
  for (const action of actions) {
    row += STEPS[action][0];
    col += STEPS[action][1];
  }
  return [row, col];
}

/** Return what the page knows of the cell that a move leads to, after the moves that still wait for their answer.
 * @param {Frame} frame the newest answer @param {readonly Action[]} waiting @param {Action} action
 * @returns {Play.Ground} */
export function groundAhead(frame, waiting, action) {
  const [row, col] = cellAfter(frame, [...waiting, action]);
  const mark = frame.grid[row]?.[col];
  if (mark === undefined) return "edge";
  if (mark === "#") return "rock";
  return mark === "?" ? "unknown" : "free";
}
