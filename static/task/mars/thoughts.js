// What a policy thinks, drawn on its own board: action probabilities as wedges round its rover, the longer the more probable; the
// cell that it heads for; and what a look from each cell should show, as a heat map. The server works the numbers out when asked.
import { policyName } from "./names.js";
import { cellAfter, markAt, WAYS } from "./ground.js";

/** Shares below it draw nothing. */
const LEAST = 0.02;

/** Return the wedges of a thought round (0, 0): a triangle for each move that has a share, its tip outward; `share` is 0..1.
 * @param {readonly number[]} probabilities @param {number} unit_px length that stands for a cell @returns {{share: number,
 * points: [number, number][]}[]} */
export function wedges(probabilities, unit_px) {
  return Object.values(WAYS).flatMap(([y, x], move) => {
    const share = probabilities[move];
    if (!(share >= LEAST)) return [];
    const near = 0.62 * unit_px;
    const far = near + (0.35 + 1.15 * share) * unit_px;
    const half = (0.2 + 0.22 * share) * unit_px;
    /** @type {[number, number][]} */
    const points = [[x * far, y * far], [x * near - y * half, y * near + x * half], [x * near + y * half, y * near - x * half]];
    return [{ share, points }];
  });
}

/** Return the thought that belongs to a board's newest frame, while there is a move to make.
 * @param {Mars.Board | null} board @returns {Mars.Thought | null} */
export function thoughtOf(board) {
  const thought = board?.thought;
  return thought && !board.frame.outcome && thought.step === board.frame.step ? thought : null;
}

/** @param {Mars.Board[]} boards @returns where the policies of boards head for, in words; "" while none of them says */
export function goalText(boards) {
  const goals = boards.flatMap((board) => {
    const goal = thoughtOf(board)?.goal;
    return goal ? [`row ${goal[0]}, column ${goal[1]}${boards.length > 1 ? ` (${policyName(board.name)})` : ""}`] : [];
  });
  return goals.join("; ");
}

/** @param {CanvasRenderingContext2D} context @param {Mars.Thought} thought @param {Cell} position
 * @param {number} size cell, device pixels @param {{accent: string, dpr: number}} look */
export function paintThought(context, thought, [row, col], size, { accent, dpr }) {
  if (thought.goal) paintGoal(context, thought.goal, size, dpr);
  context.save();
  context.translate((col + 0.5) * size, (row + 0.5) * size);
  context.lineJoin = "round";
  for (const { share, points } of wedges(thought.probabilities ?? [], Math.max(size, 9 * dpr))) {
    context.beginPath();
    points.forEach(([x, y], index) => (index === 0 ? context.moveTo(x, y) : context.lineTo(x, y)));
    context.closePath();
    context.strokeStyle = "#0e0b0d";
    context.lineWidth = 2 * dpr;
    context.stroke();
    context.globalAlpha = 0.45 + 0.55 * share;
    context.fillStyle = accent;
    context.fill();
    context.globalAlpha = 1;
  }
  context.restore();
}

/** Mark the cell that a policy heads for: a pale frame in a dark one, which shows on any ground and in greyscale.
 * @param {CanvasRenderingContext2D} context @param {Cell} goal @param {number} size cell, device pixels @param {number} dpr */
function paintGoal(context, [row, col], size, dpr) {
  const side = Math.max(size, 9 * dpr) - 2 * dpr;
  const corner = [(col + 0.5) * size - side / 2, (row + 0.5) * size - side / 2];
  context.save();
  for (const [colour, width] of /** @type {[string, number][]} */ ([["#0e0b0d", 4.5], ["#fff3dc", 2]])) {
    context.strokeStyle = colour;
    context.lineWidth = width * dpr;
    context.strokeRect(corner[0], corner[1], side, side);
  }
  context.restore();
}

/** Return what is expected on a board while there is a move to make. It may be a move old: the next answer is on its way.
 * @param {Mars.Board | null} board @returns {Mars.Expected | null} */
export const expectedOf = (board) => (board?.expected && !board.frame.outcome ? board.expected : null);

/** @param {Mars.Expected | null} expected @returns the most cells that a look should show from anywhere; at least 1 */
export const mostExpected = (expected) => (expected?.cells ?? []).reduce((most, [, , count]) => Math.max(most, count), 1);

/** Return what a look after each possible next move should show, in words: an arrow and a number for each.
 * @param {Mars.Frame} frame @param {Mars.Expected} expected */
export function nextLooks({ grid, position }, { cells }) {
  const counts = new Map(cells.map(([r, c, count]) => [`${r},${c}`, count]));
  return Object.keys(WAYS).flatMap((action, index) => {
    const cell = cellAfter(position, action);
    const mark = markAt(grid, cell);
    return mark && mark !== "#" ? [`${"\u2191\u2192\u2193\u2190"[index]}\u202f${counts.get(String(cell)) ?? 0}`] : [];
  }).join("  ");
}

/** Return how strongly a cell is tinted, 0..1.
 * @param {number} count cells that a look from it should show @param {number} most */
export const tint = (count, most) => 0.1 + 0.75 * Math.sqrt(count / most);

/** Tint the cells of a board.
 * @param {CanvasRenderingContext2D} context @param {Mars.Tint} tinted @param {number} size cell, device pixels
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
