// @ts-check
// What a look from each cell should show a policy, as a heat map on its own board. The server works the numbers out when asked.

/** @type {[string, number, number][]} arrow, rows down, columns right: north, east, south, west */
const NEXT = [["\u2191", -1, 0], ["\u2192", 0, 1], ["\u2193", 1, 0], ["\u2190", 0, -1]];

/** Return what is expected on a board while there is a move to make. It may be a move old: the next answer is on its
 * way.
 * @param {Board | null} board @returns {Expected | null} */
export const expectedOf = (board) => (board?.expected && !board.frame.outcome ? board.expected : null);

/** @param {Expected} expected @returns the most cells that a look should show from anywhere; at least 1 */
export const mostExpected = ({ cells }) => cells.reduce((most, [, , count]) => Math.max(most, count), 1);

/** Return what a look after each possible next move should show, in words: an arrow and a number for each.
 * @param {Frame} frame @param {Expected} expected */
export function nextLooks({ grid, position: [row, col] }, { cells }) {
  const counts = new Map(cells.map(([r, c, count]) => [`${r},${c}`, count]));
  return NEXT.flatMap(([arrow, down, right]) => {
    const mark = grid[row + down]?.[col + right];
    return mark && mark !== "#" ? [`${arrow}\u202f${counts.get(`${row + down},${col + right}`) ?? 0}`] : [];
  }).join("  ");
}

/** Return how strongly a cell is tinted, 0..1.
 * @param {number} count cells that a look from it should show @param {number} most */
export const tint = (count, most) => 0.1 + 0.75 * Math.sqrt(count / most);

/** Tint the cells of a board.
 * @param {CanvasRenderingContext2D} context @param {Tint} tinted @param {number} size cell, device pixels
 * @param {string} colour */
export function paintExpected(context, { expected, most }, size, colour) {
  const gap = size >= 7 ? 1 : 0;
  context.save();
  context.fillStyle = colour;
  for (const [row, col, count] of expected.cells) {
    context.globalAlpha = tint(count, most);
    context.fillRect(col * size, row * size, size - gap, size - gap);
  }
  context.restore();
}
