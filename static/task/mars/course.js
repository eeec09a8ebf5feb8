// A finished episode: its course, the board after any number of moves, what the last of them did, and what Expert would do
// there: how sure it is of each move, as wedges round the rover, and a line in moves.
import { many } from "../../common/words.js";
import { WAYS } from "./ground.js";

/** Return the course that the frames of an ended episode tell; null without frames. Long ones come with frames left
 * out: the board stays as it was then.
 * @param {string} name @param {Mars.Frame[]} frames @returns {Mars.Course | null} */
export function courseOf(name, frames) {
  const end = frames[frames.length - 1];
  if (!end) return null;
  /** @type {Mars.Frame[]} */
  const shown = [];
  for (const frame of frames) {
    while (shown.length < frame.step) shown.push(shown[shown.length - 1]);
    shown[frame.step] = frame;
  }
  const known_since = end.grid.map((line, row) =>
    Array.from(line, (_, col) => frames.find(({ grid }) => grid[row][col] !== "?")?.step ?? -1));
  return {
    name, known_since, cells: end.cells, outcome: /** @type {Mars.Course["outcome"]} */ (end.outcome), score: Number(end.score), sentence: "",
    grid: end.grid.map((line) => line.replace("@", ".")),
    actions: shown.slice(1).map(({ heading }) => heading), positions: shown.map(({ position }) => position),
    discovered: shown.map(({ discovered }) => discovered),
  };
}

/** @param {Mars.Course} course @param {number} step */
const clamped = ({ actions }, step) => Math.max(0, Math.min(step, actions.length));

/** @param {Mars.Course} course @param {number} step @returns the share of the cells that is known, 0..1 */
export const progressAt = (course, step) => course.discovered[clamped(course, step)] / course.cells;

/** Return the board as it stood after `step` moves; a run that has ended stays at its end.
 * @param {Mars.Course} course @param {number} step @returns {{frame: Mars.Frame, trail: Cell[]}} */
export function boardAt(course, step) {
  const at = clamped(course, step);
  const grid = course.grid.map((line, row) => {
    const since = course.known_since[row];
    let known = "";
    for (let col = 0; col < line.length; col++) known += since[col] >= 0 && since[col] <= at ? line[col] : "?";
    return known;
  });
  const frame = {
    kind: /** @type {const} */ ("frame"), episode: course.name, step: at, rows: grid.length, cols: grid[0].length, grid,
    position: course.positions[at], discovered: course.discovered[at], cells: course.cells,
    coverage: progressAt(course, at), heading: at ? course.actions[at - 1] : "east", reward: null, return: null, score: null,
    outcome: step >= course.actions.length ? course.outcome : null,
  };
  return { frame, trail: course.positions.slice(0, at + 1) };
}

const SHOWN_NOW = "rgba(255, 222, 170, 0.38)";
/** CSS pixels a cell below which the rover wears a ring. */
const SMALL = 8;

/** @param {Mars.Course} course @param {number} step @returns {Cell[]} the cells that became known with the last move */
export function newCells(course, step) {
  if (step < 1 || step > course.actions.length) return [];
  return course.known_since.flatMap((line, row) =>
    line.flatMap((since, col) => (since === step ? [/** @type {Cell} */ ([row, col])] : [])));
}

/** Draw over a board what the last move has shown, and a ring round a rover too small to be found at once.
 * @param {HTMLElement} place @param {Mars.Course} course @param {number} step @param {Look} look */
export function paintEvents(place, course, step, { accent, dpr }) {
  const canvas = /** @type {HTMLCanvasElement} */ (place.querySelector("canvas"));
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  const size = canvas.width / course.grid[0].length;
  const at = course.positions[clamped(course, step)];
  context.fillStyle = SHOWN_NOW;
  for (const [row, col] of newCells(course, step)) {
    if (row !== at[0] || col !== at[1]) context.fillRect(col * size, row * size, size, size);
  }
  if (size < SMALL * dpr) paintRing(context, at, size, accent, dpr);
}

/** @param {CanvasRenderingContext2D} context @param {Cell} position @param {number} size of a cell in device pixels
 * @param {string} accent @param {number} dpr */
function paintRing(context, [row, col], size, accent, dpr) {
  context.beginPath();
  context.arc((col + 0.5) * size, (row + 0.5) * size, 8 * dpr, 0, 2 * Math.PI);
  context.strokeStyle = accent;
  context.lineWidth = 2 * dpr;
  context.stroke();
}

/** Shares below it draw nothing. */
const LEAST = 0.02;

/** Return a triangle for each move that has a share, round (0, 0) and its tip outward; `share` is 0..1.
 * @param {readonly number[]} shares @param {number} unit_px length that stands for a cell
 * @returns {{share: number, points: [number, number][]}[]} */
export function wedges(shares, unit_px) {
  return Object.values(WAYS).flatMap(([y, x], move) => {
    const share = shares[move];
    if (!(share >= LEAST)) return [];
    const near = 0.62 * unit_px;
    const far = near + (0.35 + 1.15 * share) * unit_px;
    const half = (0.2 + 0.22 * share) * unit_px;
    /** @type {[number, number][]} */
    const points = [[x * far, y * far], [x * near - y * half, y * near + x * half], [x * near + y * half, y * near - x * half]];
    return [{ share, points }];
  });
}

/** @param {CanvasRenderingContext2D} context @param {readonly number[]} shares @param {Cell} position
 * @param {number} size cell, device pixels @param {{colour: string, dpr: number}} look */
export function paintShares(context, shares, [row, col], size, { colour, dpr }) {
  context.save();
  context.translate((col + 0.5) * size, (row + 0.5) * size);
  context.lineJoin = "round";
  for (const { share, points } of wedges(shares, Math.max(size, 9 * dpr))) {
    context.beginPath();
    points.forEach(([x, y], index) => (index === 0 ? context.moveTo(x, y) : context.lineTo(x, y)));
    context.closePath();
    context.strokeStyle = "#0e0b0d";
    context.lineWidth = 2 * dpr;
    context.stroke();
    context.globalAlpha = 0.45 + 0.55 * share;
    context.fillStyle = colour;
    context.fill();
    context.globalAlpha = 1;
  }
  context.restore();
}

/** Return what Expert would do after `step` moves of an episode, and what the next move of it cost.
 * @param {Answers.Advice} advice @param {Mars.Course} course @param {number} step */
export function adviceText({ action, needs, cost }, { actions, outcome }, step) {
  const made = actions[step];
  const end = needs === null ? "not get there in the moves that are left" : `need ${many(needs, "more move")} from here`;
  if (made === action) return `Expert would go ${action} too, and ${end}.`;
  const isEnd = step === actions.length - 1 && (outcome === "collided" || outcome === "out_of_bounds");
  return `Expert would go ${action} and ${end}; the move made, ${made}, ${isEnd ? "ended the episode" : costText(cost)}.`;
}
/** @param {number} cost */
function costText(cost) {
  if (cost === 0) return "was as good";
  return cost > 0 ? `cost ${many(cost, "move")}` : `gained ${many(-cost, "move")}, as it turned out`;
}
