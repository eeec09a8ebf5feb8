// What the moves of an episode cost, in sentences; no document here, so that node can test every one.
import { capital, many } from "../../common/words.js";
import { cellAfter, markAt, WAYS } from "./ground.js";
import { policyName } from "./words.js";

/** Return on which side of the rover cells lie, as steps down and right: 0 where they lie on both sides.
 * @param {Cell[]} cells @param {Cell} rover @returns {Cell} */
function sideOf(cells, rover) {
  const [down, right] = rover.map((place, axis) => {
    const steps = cells.map((cell) => Math.sign(cell[axis] - place));
    return steps.every((step) => step === steps[0]) ? steps[0] : 0;
  });
  return [down, right];
}

/** @param {Cell[]} cells @param {Cell} rover @returns where cells lie from the rover, "" where all around */
export function placeOf(cells, rover) {
  const [down, right] = sideOf(cells, rover);
  const names = [["north", "", "south"][down + 1], ["west", "", "east"][right + 1]].filter(Boolean);
  return names.length ? ` to the ${names.join("-")}` : "";
}

/** @param {Mars.Mistake} mistake what was done at its costliest move */
function whatWasDone({ action, previous, position, grid, kind }) {
  if (kind === "ended early") return markAt(grid, cellAfter(position, action)) ? "you drove into a rock" : "you drove over the edge of the map";
  if (previous === null) return `you began by going ${action}`;
  if (action === previous) return `you went on ${action}`;
  const isBack = WAYS[previous].every((way, index) => way + WAYS[action][index] === 0);
  return `you turned ${isBack ? "back " : ""}${action}`;
}

/** @param {Mars.Mistake} mistake */
function whatExpertDoes({ step, expert_action: action, missed, seen_at, position, kind }) {
  if (kind === "ended early") return `going ${action} was free`;
  if (missed.length) {
    const seen = seen_at === null ? "which you never saw" : `which you saw only ${many(seen_at - step, "move")} later`;
    const leadsAway = sideOf(missed, position).some((side, axis) => side * WAYS[action][axis] < 0);
    const way = leadsAway ? `Expert's way, which begins ${action},` : `going ${action}`;
    return `${way} would soon have shown ${many(missed.length, "unknown cell")}${placeOf(missed, position)}, ${seen}`;
  }
  return kind === "last cells" ? `going ${action} was the shorter way to the last cells` : `going ${action} was the shorter way`;
}

/** @param {Mars.Mistake} mistake @returns the sentence about a mistake; an end for good costs no number of moves */
export function sentenceOf(mistake) {
  const { first, last, step, cost, kind } = mistake;
  const doing = `${whatWasDone(mistake)}; ${whatExpertDoes(mistake)}.`;
  if (kind === "ended early") return `Move ${step + 1} ended the episode: ${doing}`;
  if (first === last) return `Move ${step + 1} cost ${many(cost, "move")}: ${doing}`;
  return `Moves ${first + 1} to ${last + 1} cost ${many(cost, "move")}: at move ${step + 1} ${doing}`;
}

/** Return what an episode tried again from a move came to: "80 moves before, 76 now, from move 9."
 * @param {number | null} before moves to the goal, null where it was not reached @param {number | null} now @param {number} move */
export function triedText(before, now, move) {
  const was = before === null ? "Not finished before" : `${many(before, "move")} before`;
  return `${was}, ${now ?? "not finished"} now, from move ${move}.`;
}

/** @param {number} gap moves @returns how many more or fewer they are */
export function gapText(gap) {
  if (gap === 0) return "as many";
  return `${Math.abs(gap)} ${gap > 0 ? "more" : "fewer"}`;
}

/** @param {Answers.Costs} costs @returns the sentence above the list: the whole difference, and why no move is judged if none is */
export function summaryOf({ policy, reason, counts, expert_moves: expert, total, mistakes, given_up }) {
  const name = policyName(policy);
  const whole = expert === null || total === null ? "" : `Your episode counts ${many(counts, "move")}, ${name}'s ${expert}: ${gapText(total)}. `;
  if (reason !== null) return `${whole}${capital(reason)}.`;
  const end = given_up ? `Giving up cost ${many(given_up, "move")}: ${name} would have finished from there. ` : "";
  const named = mistakes.length ? "" : "No mistake cost 2 moves or more. ";
  return `${whole}${end}${named}Judged with the whole terrain known, and ${name} playing on after each move.`;
}

/** Return the sentences below the list: what the mistakes cost that are not in it, and what other moves gained.
 * @param {Answers.Costs} costs */
export function restOf({ policy, total, given_up, gained, mistakes }) {
  if (total === null || given_up === null || gained === null) return [];
  const others = total - given_up - gained - mistakes.reduce((sum, { cost }) => sum + cost, 0);
  return [
    ...(others ? [`Other mistakes cost ${many(others, "move")} in all.`] : []),
    ...(gained ? [`Moves that turned out better than ${policyName(policy)}'s gained ${many(-gained, "move")}.`] : []),
  ];
}

/** @param {Answers.Costs} costs @returns all of it: what stands above the list, the list, and below it */
export const costsInWords = (costs) => ({ summary: summaryOf(costs), mistakes: costs.mistakes.map(sentenceOf), rest: restOf(costs) });
