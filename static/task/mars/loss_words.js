// @ts-check
// Where moves were lost, in words.
import { many } from "../../common/words.js";
import { cellAfter, markAt, WAYS } from "./ground.js";

/** Return "low" or "high" where numbers reach that end of 0..length-1 and lie in its half alone, "" otherwise.
 * @param {number[]} numbers @param {number} length */
function endOf(numbers, length) {
  const [low, high] = [Math.min(...numbers), Math.max(...numbers)];
  if (low === 0 && high < length / 2) return "low";
  return high === length - 1 && low >= length / 2 ? "high" : "";
}

/** Return where on the map cells lie: in a corner, at an edge, or "" for anywhere else.
 * @param {Cell[]} cells @param {string[]} grid */
export function placeOf(cells, grid) {
  const up = { low: "north", high: "south", "": "" }[endOf(cells.map(([row]) => row), grid.length)];
  const across = { low: "west", high: "east", "": "" }[endOf(cells.map(([, col]) => col), grid[0].length)];
  if (up && across) return ` in the ${up}-${across} corner`;
  return up || across ? ` at the ${up || across} edge` : "";
}

/** @param {Mars.CostlyMove} loss */
function whatWasDone({ action, previous, position, grid, kind }) {
  if (kind === "ended early") return markAt(grid, cellAfter(position, action)) ? "you drove into a rock" : "you drove over the edge of the map";
  if (previous === null) return `you began by going ${action}`;
  if (action === previous) return `you went on ${action}`;
  const isBack = WAYS[previous].every((way, index) => way + WAYS[action][index] === 0);
  return `you turned ${isBack ? "back " : ""}${action}`;
}

/** @param {Mars.CostlyMove} loss */
function whatWasBetter({ step, best_action: better, missed, seen_at, grid, kind }) {
  if (kind === "ended early") return `going ${better} was free`;
  if (missed.length) {
    const seen = seen_at === null ? "which you never saw" : `which you saw only ${many(seen_at - step, "move")} later`;
    return `going ${better} would soon have shown ${many(missed.length, "unknown cell")}${placeOf(missed, grid)}, ${seen}`;
  }
  return kind === "last cells" ? `going ${better} was the shorter way to the last cells` : `going ${better} was the shorter way`;
}

/** @param {Mars.CostlyMove} loss @returns the sentence about a move */
export function sentenceOf(loss) {
  return `Move ${loss.step + 1} cost about ${many(loss.regret, "move")}: ${whatWasDone(loss)}; ${whatWasBetter(loss)}.`;
}

/** @param {Mars.Analysis} analysis @returns the sentence above the list of moves */
export function summaryOf({ policy, losses, given_up }) {
  const judged = `Judged by how ${policy} would have finished from each move, with the whole terrain known.`;
  if (given_up > 0) return `Giving up cost ${many(given_up, "move")}: ${policy} would have finished from there. ${judged}`;
  if (!losses.length) return `No single move cost you much. ${judged}`;
  return losses.length === 1 ? `One move cost you the most. ${judged}` : `These ${losses.length} moves cost you the most. ${judged}`;
}
