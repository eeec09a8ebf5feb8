// What the moves of an episode cost, in sentences; no document here, so that node can test every one.
import { plural, t } from "../../common/texts.js";
import { actionText, capital, many, movesText } from "../../common/words.js";
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
  return [
    [t("mars.side.north_west", " to the north-west"), t("mars.side.north", " to the north"), t("mars.side.north_east", " to the north-east")],
    [t("mars.side.west", " to the west"), "", t("mars.side.east", " to the east")],
    [t("mars.side.south_west", " to the south-west"), t("mars.side.south", " to the south"), t("mars.side.south_east", " to the south-east")],
  ][down + 1][right + 1];
}

/** @param {Mars.Mistake} mistake what was done at its costliest move */
function whatWasDone({ action, previous, position, grid, kind }) {
  if (kind === "ended early") {
    return markAt(grid, cellAfter(position, action)) ? t("mars.did.rock", "you drove into a rock") : t("mars.did.edge", "you drove over the edge of the map");
  }
  const way = { way: actionText(action) };
  if (previous === null) return t("mars.did.began", "you began by going {way}", way);
  if (action === previous) return t("mars.did.went_on", "you went on {way}", way);
  const isBack = WAYS[previous].every((step, index) => step + WAYS[action][index] === 0);
  return isBack ? t("mars.did.back", "you turned back {way}", way) : t("mars.did.turned", "you turned {way}", way);
}

/** @param {Mars.Mistake} mistake */
function whatExpertDoes({ step, expert_action: action, missed, seen_at, position, kind }) {
  const way = actionText(action);
  if (kind === "ended early") return t("mars.better.free", "going {way} was free", { way });
  if (missed.length) {
    const leadsAway = sideOf(missed, position).some((side, axis) => side * WAYS[action][axis] < 0);
    const values = { way, cells: plural("mars.unknown_cells", missed.length, "{n} unknown cell", "{n} unknown cells"), place: placeOf(missed, position),
      seen: seen_at === null && missed.length > 1 ? t("mars.better.some", "some of which you never saw")
        : seen_at === null ? t("mars.better.never", "which you never saw")
        : t("mars.better.later", "which you saw only {moves} later", { moves: movesText(seen_at - step) }) };
    return leadsAway ? t("mars.better.away", "Expert's way, which begins {way}, would soon have shown {cells}{place}, {seen}", values)
      : t("mars.better.shown", "going {way} would soon have shown {cells}{place}, {seen}", values);
  }
  return kind === "last cells" ? t("mars.better.last", "going {way} was the shorter way to the last cells", { way })
    : t("mars.better.shorter", "going {way} was the shorter way", { way });
}

/** @param {Mars.Mistake} mistake @returns the sentence about a mistake; an end for good costs no number of moves */
export function sentenceOf(mistake) {
  const { first, last, step, cost, kind } = mistake;
  const values = { move: step + 1, first: first + 1, last: last + 1, cost: movesText(cost), did: whatWasDone(mistake), better: whatExpertDoes(mistake) };
  if (kind === "ended early") return t("mars.mistake.end", "Move {move} ended the episode: {did}; {better}.", values);
  if (first === last) return t("mars.mistake.one", "Move {move} cost {cost}: {did}; {better}.", values);
  return t("mars.mistake.more", "Moves {first} to {last} cost {cost}: at move {move} {did}; {better}.", values);
}

/** Return what an episode tried again from a move came to: "80 moves before, 76 now, from move 9."
 * @param {number | null} before moves to the goal, null where it was not reached @param {number | null} now @param {number} move */
export function triedText(before, now, move) {
  const was = before === null ? "Not finished before" : `${many(before, "move")} before`;
  return `${was}, ${now ?? "not finished"} now, from move ${move}.`;
}

/** @param {number} gap moves @returns how many more or fewer they are */
export function gapText(gap) {
  if (gap === 0) return t("mars.gap.none", "as many");
  return gap > 0 ? t("mars.gap.more", "{n} more", { n: gap }) : t("mars.gap.fewer", "{n} fewer", { n: -gap });
}

/** @param {Answers.Costs} costs @returns the sentence above the list: the whole difference, and why no move is judged if none is */
export function summaryOf({ policy, reason, counts, expert_moves: expert, total, mistakes, given_up }) {
  const name = policyName(policy);
  const whole = expert === null || total === null ? ""
    : t("mars.costs.whole", "Your episode counts {moves}, {policy}'s {expert}: {gap}. ", { moves: movesText(counts), policy: name, expert, gap: gapText(total) });
  if (reason !== null) return `${whole}${capital(reason)}.`;
  const end = given_up ? t("mars.costs.given_up", "Giving up cost {moves}: {policy} would have finished from there. ", { moves: movesText(given_up), policy: name }) : "";
  const named = mistakes.length ? "" : t("mars.costs.none", "No mistake cost 2 moves or more. ");
  return `${whole}${end}${named}${t("mars.costs.judged", "Judged with the whole terrain known, and {policy} playing on after each move.", { policy: name })}`;
}

/** Return the sentences below the list: what the mistakes cost that are not in it, and what other moves gained.
 * @param {Answers.Costs} costs */
export function restOf({ policy, total, given_up, gained, mistakes }) {
  if (total === null || given_up === null || gained === null) return [];
  const others = total - given_up - gained - mistakes.reduce((sum, { cost }) => sum + cost, 0);
  return [
    ...(others ? [t("mars.costs.others", "Other mistakes cost {moves} in all.", { moves: movesText(others) })] : []),
    ...(gained ? [t("mars.costs.gained", "Moves that turned out better than {policy}'s gained {moves}.", { policy: policyName(policy), moves: movesText(-gained) })] : []),
  ];
}

/** @param {Answers.Costs} costs @returns all of it: what stands above the list, the list, and below it */
export const costsInWords = (costs) => ({ summary: summaryOf(costs), mistakes: costs.mistakes.map(sentenceOf), rest: restOf(costs) });
