// @ts-check
// Where moves were lost, in words: the sentences about costly moves, and the list of them in the debrief of a study.
import { create } from "./page.js";
import { many } from "./words.js";

/** @param {Loss} loss @returns the sentence of one loss */
function lossLine({ step, regret, action, best_action, kind }) {
  const why = { "hidden pocket": ", leaving a pocket behind", "last cells": ", on the last cells" }[kind] ?? "";
  return `Move ${step + 1}: you lost ${many(regret, "move")} going ${action} instead of ${best_action}${why}.`;
}

/** @param {Regret} regret @returns the sentence above the list */
function regretLine({ policy, losses, given_up }) {
  if (given_up > 0) return `Giving up cost ${many(given_up, "move")}: ${policy} would have finished from there.`;
  if (!losses.length) return "No single move cost you much.";
  return `Judged with the whole terrain known, and ${policy} going on after each move.`;
}

/** Fill a place with the losses of an episode, the greatest first, each with a button.
 * @param {HTMLElement} place @param {Regret} regret
 * @param {{label: string, onChoose: (loss: Loss) => void}} button what it says and does */
export function paintLosses(place, regret, { label, onChoose }) {
  const list = place.ownerDocument.createElement("ol");
  for (const loss of regret.losses) {
    const item = create("li", `${lossLine(loss)} `);
    const choose = /** @type {HTMLButtonElement} */ (create("button", label, { type: "button", class: "quiet" }));
    choose.setAttribute("aria-label", `${label}: move ${loss.step + 1}`);
    choose.addEventListener("click", () => onChoose(loss));
    item.append(choose);
    list.append(item);
  }
  place.replaceChildren(create("p", regretLine(regret)), list);
}

/** @type {Record<Action, {back: Action, down: number, right: number}>} */
const WAYS = {
  north: { back: "south", down: -1, right: 0 }, east: { back: "west", down: 0, right: 1 },
  south: { back: "north", down: 1, right: 0 }, west: { back: "east", down: 0, right: -1 },
};

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

/** @param {CostlyMove} loss */
function whatWasDone({ action, previous, position: [row, col], grid, kind }) {
  if (kind === "ended early") {
    const { down, right } = WAYS[action];
    return grid[row + down]?.[col + right] ? "you drove into a rock" : "you drove over the edge of the map";
  }
  if (previous === null) return `you began by going ${action}`;
  if (action === previous) return `you went on ${action}`;
  return `you turned ${WAYS[previous].back === action ? "back " : ""}${action}`;
}

/** @param {CostlyMove} loss */
function whatWasBetter({ step, best_action: better, missed, seen_at, grid, kind }) {
  if (kind === "ended early") return `going ${better} was free`;
  if (missed.length) {
    const seen = seen_at === null ? "which you never saw" : `which you saw only ${many(seen_at - step, "move")} later`;
    return `going ${better} would soon have shown ${many(missed.length, "unknown cell")}${placeOf(missed, grid)}, ${seen}`;
  }
  return kind === "last cells" ? `going ${better} was the shorter way to the last cells` : `going ${better} was the shorter way`;
}

/** @param {CostlyMove} loss @returns the sentence about a move */
export function sentenceOf(loss) {
  return `Move ${loss.step + 1} cost about ${many(loss.regret, "move")}: ${whatWasDone(loss)}; ${whatWasBetter(loss)}.`;
}

/** @param {Analysis} analysis @returns the sentence above the list of moves */
export function summaryOf({ policy, losses, given_up }) {
  const judged = `Judged by how ${policy} would have finished from each move, with the whole terrain known.`;
  if (given_up > 0) return `Giving up cost ${many(given_up, "move")}: ${policy} would have finished from there. ${judged}`;
  if (!losses.length) return `No single move cost you much. ${judged}`;
  return losses.length === 1 ? `One move cost you the most. ${judged}` : `These ${losses.length} moves cost you the most. ${judged}`;
}
