// @ts-check
// The course of an episode, and its board after any number of moves. No document here, so that node can test it.

/**
 * @typedef {import("../common/messages.js").Action} Action
 * @typedef {import("../common/messages.js").Cell} Cell
 * @typedef {import("../common/messages.js").Frame} Frame
 */
/**
 * What GET api/episodes/ID/ghost answers. Index k of positions and discovered is the board after k moves; known_since says after how
 * many moves each cell was known (-1: never); `cells` is how many coverage refers to.
 * @typedef {{name: string, actions: Action[], positions: Cell[], discovered: number[], cells: number, grid: string[], known_since: number[][],
 *   outcome: import("../common/messages.js").Outcome, score: number, sentence: string}} Course
 */
/**
 * What stands in the page: the episode's own course and the policies on offer; in a page that is one file the policy's course, too.
 * @typedef {{episode: string, level: string, rows: number, cols: number, run: Course, ghosts: string[], preferred: string | null,
 *   ghost?: Course | null}} ReplayData
 */

/**
 * Return the number of moves of a course.
 * @param {Course} course
 */
export const movesOf = ({ actions }) => actions.length;

/**
 * Return the moves that a course has made when a replay stands at `step`: one that has ended stays at its end.
 * @param {Course} course
 * @param {number} step
 */
export const clamped = (course, step) => Math.max(0, Math.min(step, movesOf(course)));

/**
 * Return the share of the cells that is known, 0..1.
 * @param {Course} course
 * @param {number} step
 */
export const coverageAt = (course, step) => course.discovered[clamped(course, step)] / course.cells;

/**
 * Return whether a course has ended when a replay stands at `step`.
 * @param {Course} course
 * @param {number} step
 */
export const hasEnded = (course, step) => step >= movesOf(course);

/**
 * Return the board as it stood after `step` moves, for the painter of boards.
 * @param {Course} course
 * @param {number} step
 * @returns {{frame: Frame, trail: Cell[]}}
 */
export function boardAt(course, step) {
  const at = clamped(course, step);
  const grid = course.grid.map((line, row) => {
    const since = course.known_since[row];
    let known = "";
    for (let col = 0; col < line.length; col++) known += since[col] >= 0 && since[col] <= at ? line[col] : "?";
    return known;
  });
  const frame = {
    kind: /** @type {const} */ ("frame"), episode: course.name, step: at, rows: grid.length, cols: grid[0].length, grid, position: course.positions[at],
    discovered: course.discovered[at], cells: course.cells, coverage: coverageAt(course, at), heading: at ? course.actions[at - 1] : /** @type {Action} */ ("east"),
    reward: null, return: null, score: null, outcome: hasEnded(course, step) ? course.outcome : null,
  };
  return { frame, trail: course.positions.slice(0, at + 1) };
}

/**
 * Return the cells that became known with the last move.
 * @param {Course} course
 * @param {number} step
 * @returns {Cell[]}
 */
export function newCells(course, step) {
  if (step < 1 || step > movesOf(course)) return [];
  return course.known_since.flatMap((line, row) => line.flatMap((since, col) => (since === step ? [/** @type {Cell} */ ([row, col])] : [])));
}

const TOWARD = { north: [-1, 0], east: [0, 1], south: [1, 0], west: [0, -1] };

/**
 * Return the cell of the rock that the rover has crashed into, or the cell off the map that it has driven to; null otherwise.
 * @param {Course} course
 * @param {number} step
 * @returns {Cell | null}
 */
export function crashAt(course, step) {
  if (!hasEnded(course, step) || !["collided", "out_of_bounds"].includes(course.outcome)) return null;
  const moves = movesOf(course);
  const [down, right] = TOWARD[course.actions[moves - 1]];
  const [row, col] = course.positions[moves];
  const [beforeRow, beforeCol] = course.positions[moves - 1];
  return row === beforeRow && col === beforeCol ? [row + down, col + right] : [row, col];
}
