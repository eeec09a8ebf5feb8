// @ts-check
// Paints one run of a replay: its board, what the last move has shown, a crash, and its numbers.
import { create, put } from "../common/page.js";
import { hasEnded, movesOf, paintCourse } from "../common/player.js";
import { percent } from "../common/words.js";

const SHOWN_NOW = "rgba(255, 222, 170, 0.38)";
const CRASH = "#ff5c45";
/** CSS pixels a cell below which the rover wears a ring. */
const SMALL = 8;
const TOWARD = { north: [-1, 0], east: [0, 1], south: [1, 0], west: [0, -1] };

/** @param {Course} course @param {number} step @returns {Cell[]} the cells that became known with the last move */
export function newCells(course, step) {
  if (step < 1 || step > movesOf(course)) return [];
  return course.known_since.flatMap((line, row) =>
    line.flatMap((since, col) => (since === step ? [/** @type {Cell} */ ([row, col])] : [])));
}

/** Return the cell of the rock that the rover has crashed into, or the cell off the map that it has driven to; null
 * otherwise.
 * @param {Course} course @param {number} step @returns {Cell | null} */
export function crashAt(course, step) {
  if (!hasEnded(course, step) || !["collided", "out_of_bounds"].includes(course.outcome ?? "")) return null;
  const moves = movesOf(course);
  const [down, right] = TOWARD[course.actions[moves - 1]];
  const [row, col] = course.positions[moves];
  const [beforeRow, beforeCol] = course.positions[moves - 1];
  return row === beforeRow && col === beforeCol ? [row + down, col + right] : [row, col];
}

/** Return the elements of a run's section by their `data-part`.
 * @param {HTMLElement} root @returns {Record<string, HTMLElement>} */
export function partsOf(root) {
  return Object.fromEntries(Array.from(root.querySelectorAll("[data-part]"), (each) => [/** @type {HTMLElement} */ (each).dataset.part, each]));
}

/** Paint a run as it stood after `step` moves.
 * @param {Record<string, HTMLElement>} part @param {Course} course @param {number} step
 * @param {{accent: string, soil: Soil, other: {course: Course, accent: string} | null, dpr: number}} look other is the
 *   run whose path is drawn dashed */
export function paintRun(part, course, step, look) {
  const canvas = /** @type {HTMLCanvasElement} */ (part.canvas);
  const frame = paintCourse(canvas, part.ground, course, step, look);
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  const size = canvas.width / frame.cols;
  paintEvents(context, course, step, size);
  if (size < SMALL * look.dpr) paintRing(context, frame.position, size, look.accent, look.dpr);
  put(part.moves, String(frame.step));
  put(part.noun, frame.step === 1 ? "move" : "moves");
  put(part.coverage, percent(frame.coverage));
  put(part.outcome, hasEnded(course, step) ? course.sentence : "exploring");
  part.outcome.dataset.outcome = hasEnded(course, step) ? course.outcome ?? "" : "";
}

/** @param {CanvasRenderingContext2D} context @param {Course} course @param {number} step
 * @param {number} size of a cell in device pixels */
function paintEvents(context, course, step, size) {
  const at = course.positions[Math.min(step, course.positions.length - 1)];
  context.fillStyle = SHOWN_NOW;
  for (const [row, col] of newCells(course, step)) {
    if (row !== at[0] || col !== at[1]) context.fillRect(col * size, row * size, size, size);
  }
  const crash = crashAt(course, step);
  if (!crash) return;
  const x = Math.max(0.5, Math.min(crash[1] + 0.5, course.grid[0].length - 0.5)) * size;
  const y = Math.max(0.5, Math.min(crash[0] + 0.5, course.grid.length - 0.5)) * size;
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

/** Draw a ring round a rover that is too small to be found at once.
 * @param {CanvasRenderingContext2D} context @param {Cell} position @param {number} size of a cell in device pixels
 * @param {string} accent @param {number} dpr */
function paintRing(context, [row, col], size, accent, dpr) {
  context.beginPath();
  context.arc((col + 0.5) * size, (row + 0.5) * size, 8 * dpr, 0, 2 * Math.PI);
  context.strokeStyle = accent;
  context.lineWidth = 2 * dpr;
  context.stroke();
}

/** Fill the choice of policies; the last one shows none.
 * @param {HTMLSelectElement} select @param {string[]} names @param {string | null} chosen */
export function offerGhosts(select, names, chosen) {
  select.replaceChildren(...names.map((name) => create("option", name, { value: name })), create("option", "no policy", { value: "" }));
  select.value = chosen ?? "";
}
