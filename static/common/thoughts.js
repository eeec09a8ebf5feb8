// @ts-check
// A policy's action probabilities as wedges round its rover, the longer the more probable; the cell that it heads for; and the paths
// drawn on the other board.

/** Shares below it draw nothing. */
const LEAST = 0.02;
/** @type {[number, number][]} unit vectors (x, y) of north, east, south, west */
const OUTWARD = [[0, -1], [1, 0], [0, 1], [-1, 0]];

/** Return the wedges of a thought round (0, 0): a triangle for each move that has a share, its tip outward; `share` is
 * 0..1.
 * @param {readonly number[]} probabilities @param {number} unit_px length that stands for a cell
 * @returns {{share: number, points: [number, number][]}[]} */
export function wedges(probabilities, unit_px) {
  return OUTWARD.flatMap(([x, y], move) => {
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
 * @param {Board | null} board @returns {Thought | null} */
export function thoughtOf(board) {
  const thought = board?.thought;
  return thought && !board.frame.outcome && thought.step === board.frame.step ? thought : null;
}

/** @param {Board[]} boards @returns where the policies of boards head for, in words; "" while none of them says */
export function goalText(boards) {
  const goals = boards.flatMap((board) => {
    const goal = thoughtOf(board)?.goal;
    return goal ? [`row ${goal[0]}, column ${goal[1]}${boards.length > 1 ? ` (${board.name})` : ""}`] : [];
  });
  return goals.join("; ");
}

/** Return the path to draw under a board's own: the other's, once the player's episode has ended and both are on one
 * terrain.
 * @param {GameState} state @param {"player" | "rival"} role @returns {Cell[] | null} */
export function ghostOf({ player, rival }, role) {
  if (!player?.frame.outcome || !rival) return null;
  const other = role === "player" ? rival : player;
  const own = role === "player" ? player : rival;
  if (other.frame.rows !== own.frame.rows || other.frame.cols !== own.frame.cols) return null;
  return other.trail;
}

/** @param {CanvasRenderingContext2D} context @param {Thought} thought @param {Cell} position
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
 * @param {CanvasRenderingContext2D} context @param {Cell} goal @param {number} size cell, device pixels
 * @param {number} dpr */
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
