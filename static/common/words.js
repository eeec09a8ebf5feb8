// @ts-check
// Numbers and endings in words; no document here, so node can test every sentence.
import { CELL_STATES } from "./messages.js";

/** @type {Record<string, {title: string, line: string, short: string}>} */
const ENDINGS = {
  explored: { title: "Terrain explored", line: "{target} of the terrain is on the map.", short: "explored" },
  collided: { title: "Rover lost: collision", line: "The rover drove into an obstacle.", short: "collided" },
  out_of_bounds: { title: "Rover lost: off the map", line: "The rover drove over the edge of the terrain.", short: "off the map" },
  timed_out: { title: "Out of moves", line: "The last move was made before {target} was explored.", short: "out of moves" },
  abandoned: { title: "Abandoned", line: "The episode was left before its end.", short: "abandoned" },
};

/** @param {string | null} outcome */
export const outcomeTitle = (outcome) => (outcome ? ENDINGS[outcome]?.title ?? outcome : "Exploring");
/** @param {string | null} outcome */
export const outcomeShort = (outcome) => (outcome ? ENDINGS[outcome]?.short ?? outcome : "exploring");
/** @param {string | null} outcome @param {string} [target] share of the cells that completes a terrain, in words */
export const outcomeLine = (outcome, target = "99 %") => (outcome ? ENDINGS[outcome]?.line ?? "" : "").replace("{target}", target);
/** @param {number} share 0..1; rounded down, so that 99.0 never stands before the goal is reached */
export const percent = (share) => `${(Math.floor(share * 1000 + 1e-9) / 10).toFixed(1)}`;
/** @param {number | null} value null while a study keeps it to itself */
export const signed = (value) => value === null ? "\u2013" : `${value < 0 ? "\u2212" : "+"}${Math.abs(value).toFixed(1)}`;
/** @param {number | null} value null while a study keeps it to itself */
export const score = (value) => value === null ? "\u2013" : value.toFixed(3).replace("-", "\u2212");
/** @param {number | [number, number]} size */
export const sizeText = (size) => (Array.isArray(size) ? `${size[0]} \u00d7 ${size[1]}` : `${size} \u00d7 ${size}`);
/** Return a count with its noun.
 * @param {number} count @param {string} one @param {string} [more] the plural, where it is not the singular and an s */
export const many = (count, one, more = `${one}s`) => `${count} ${count === 1 ? one : more}`;

/** Return the volunteers' figure of one configuration, in short.
 * @param {{score: {mean: number}, steps: {mean: number}}} figure */
export const figure = ({ score: scores, steps }) => `${steps.mean.toFixed(1)} steps \u00b7 score ${score(scores.mean)}`;

/** @param {Frame} frame @returns the moves until 99 % was known, or null when it never was */
export function stepsToGoal(frame) {
  return frame.outcome === "explored" ? frame.step : null;
}

/** Return one sentence that compares the player with the rival on the same terrain.
 * @param {Frame} mine @param {Frame | null} theirs @param {string} rival
 * @param {string} who "You" or a policy's name */
export function compare(mine, theirs, rival, who = "You") {
  if (!theirs) return "";
  if (theirs.outcome === null) return `${rival} is still exploring: ${many(theirs.step, "move")}, ${percent(theirs.coverage)} % so far.`;
  const a = stepsToGoal(mine);
  const b = stepsToGoal(theirs);
  if (a === null && b === null) return `${rival} did not reach 99 % here either: ${outcomeShort(theirs.outcome)} after ${many(theirs.step, "move")}.`;
  if (a === null) return `${rival} reached 99 % in ${many(theirs.step, "move")}, score ${score(theirs.score)}.`;
  if (b === null) return `${rival} did not reach 99 %: ${outcomeShort(theirs.outcome)} after ${many(theirs.step, "move")}.`;
  if (a === b) return `${who} and ${rival} both needed ${many(a, "move")}.`;
  return `${who} needed ${many(Math.abs(a - b), "move")} ${a < b ? "fewer" : "more"} than ${rival} (${b}, score ${score(theirs.score)}).`;
}

const AROUND = /** @type {const} */ ([["north", -1, 0], ["east", 0, 1], ["south", 1, 0], ["west", 0, -1]]);
/** @type {Record<string, string>} */
const STATES = CELL_STATES;

/** Return the matrix in words: where the rover stands and what lies next to it.
 * @param {Frame} frame @param {string} name */
export function describeBoard(frame, name) {
  const [row, col] = frame.position;
  const around = AROUND.map(([word, down, right]) => `${word} ${STATES[frame.grid[row + down]?.[col + right] ?? ""] ?? "edge"}`);
  return `State matrix of ${name}: ${frame.rows} rows, ${frame.cols} columns. Rover at row ${row + 1}, column ${col + 1}. `
    + `${around.join(", ")}. ${percent(frame.coverage)} percent explored in ${many(frame.step, "step")}.`;
}

/** Return what a screen reader announces after a change: each tenth of the terrain, and the end; "" for all else.
 * @param {Frame | null} before @param {Frame} after */
export function announcement(before, after) {
  const scored = after.score === null ? "" : `, score ${score(after.score)}`;
  if (!before || before.episode !== after.episode) return `New terrain, ${after.rows} by ${after.cols}. ${percent(after.coverage)} percent in sight.`;
  if (after.outcome && !before.outcome) {
    return `${outcomeTitle(after.outcome)} after ${many(after.step, "step")}. Coverage ${percent(after.coverage)} percent${scored}.`;
  }
  const tenth = Math.floor(after.coverage * 10);
  if (tenth > Math.floor(before.coverage * 10)) return `${tenth * 10} percent explored, ${many(after.step, "step")}${scored}.`;
  return "";
}

/** Return the sentence for an episode that has ended and does not count, because the server could not match a move with
 * a key or a touch.
 * @param {string} reason the server's */
export const notCounted = (reason) => `This episode does not count: its moves do not all fit keys or touches of this page (${reason}).`;
