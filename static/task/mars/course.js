// A finished episode: its course, the board after any number of moves, and what the last of them did.
import { cellAfter } from "./ground.js";

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
const CRASH = "#ff5c45";
/** CSS pixels a cell below which the rover wears a ring. */
const SMALL = 8;

/** @param {Mars.Course} course @param {number} step @returns {Cell[]} the cells that became known with the last move */
export function newCells(course, step) {
  if (step < 1 || step > course.actions.length) return [];
  return course.known_since.flatMap((line, row) =>
    line.flatMap((since, col) => (since === step ? [/** @type {Cell} */ ([row, col])] : [])));
}

/** Return the cell of the rock that the rover has crashed into, or the cell off the map that it has driven to; null
 * otherwise.
 * @param {Mars.Course} course @param {number} step @returns {Cell | null} */
export function crashAt(course, step) {
  if (step < course.actions.length || !["collided", "out_of_bounds"].includes(course.outcome ?? "")) return null;
  const { actions, positions } = course;
  const [before, last] = positions.slice(actions.length - 1);
  return String(before) === String(last) ? cellAfter(last, actions[actions.length - 1]) : last;
}

/** Draw over a board what the last move has shown, a crash, and a ring round a rover too small to be found at once.
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
  const crash = crashAt(course, step);
  if (crash) paintCrash(context, course.grid, crash, size);
  if (size < SMALL * dpr) paintRing(context, at, size, accent, dpr);
}

/** @param {CanvasRenderingContext2D} context @param {string[]} grid @param {Cell} crash
 * @param {number} size of a cell in device pixels */
function paintCrash(context, grid, crash, size) {
  const x = Math.max(0.5, Math.min(crash[1] + 0.5, grid[0].length - 0.5)) * size;
  const y = Math.max(0.5, Math.min(crash[0] + 0.5, grid.length - 0.5)) * size;
  context.strokeStyle = CRASH;
  context.lineWidth = Math.max(2, size * 0.18);
  context.lineCap = "round";
  context.beginPath();
  for (const slope of [-1, 1]) {
    context.moveTo(x - size * 0.34, y - slope * size * 0.34);
    context.lineTo(x + size * 0.34, y + slope * size * 0.34);
  }
  context.stroke();
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
