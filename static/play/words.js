// @ts-check
// The playground's own sentences; no document here, so that node can test every one.
import { many, percent, score } from "../common/words.js";

/** @param {boolean} isTouch @returns what asks for the first move */
export const promptText = (isTouch) => (isTouch ? "Swipe or tap an arrow" : "Press an arrow key");

/** Return a coverage in whole percent, rounded down, so that 99 never stands before the goal is reached.
 * @param {number} share 0..1 */
export const wholePercent = (share) => `${Math.floor(100 * share + 1e-9)} %`;

/** @type {Record<string, {short: string, title: string, line: string}>} */
const ENDINGS = {
  explored: { short: "mapped", title: "Mapped in {moves}", line: "99 % of {ground} is on the map." },
  collided: { short: "crashed", title: "Crashed at {coverage} after {moves}", line: "The rover hit a rock, which ends the episode." },
  out_of_bounds: { short: "off the map", title: "Off the map at {coverage} after {moves}", line: "The rover drove over the edge of the map, which ends the episode." },
  timed_out: { short: "out of moves", title: "Out of moves at {coverage} after {moves}", line: "The last move was made before 99 % of {ground} was on the map." },
  abandoned: { short: "abandoned", title: "Abandoned at {coverage} after {moves}", line: "The episode was left before its end." },
};

/** @param {string | null} outcome @returns the state of a board in a word or two; "" while it explores */
export const outcomeWord = (outcome) => (outcome ? ENDINGS[outcome]?.short ?? outcome : "");

/** Return what coverage is a share of: the whole ground, or where walls hide some of it, what the rover can see of it.
 * @param {Pick<Frame, "rows" | "cols" | "cells">} frame */
const ground = ({ rows, cols, cells }) => (cells < rows * cols ? "what can be seen" : "the ground");

/** @param {Frame | null} frame @returns the task in one sentence */
export const goal = (frame) => `Map 99 % of ${frame ? ground(frame) : "the ground"} in as few moves as you can`;

/** @param {Frame} frame @returns how an episode ended, as a heading and as a sentence */
export function ending(frame) {
  const { title, line } = ENDINGS[frame.outcome ?? ""] ?? { title: "{coverage} after {moves}", line: "" };
  return { title: title.replace("{coverage}", wholePercent(frame.coverage)).replace("{moves}", many(frame.step, "move")), line: line.replace("{ground}", ground(frame)) };
}

/** Return the sentence that explains the score of an ended episode.
 * @param {Frame} frame @param {boolean} paysBonus whether the level pays for finishing and fines a failure */
export function scoreWhy({ outcome, score: value }, paysBonus) {
  if (value === null) return "";
  const earned = "The score adds up what you discovered";
  const scale = "0 is a crash on the first move, and nobody reaches 1.";
  if (!paysBonus) return `${earned}, less a little for each move. ${scale}`;
  if (outcome === "explored") return `${earned} and a bonus for finishing, less a little for each move. ${scale}`;
  return `${earned}, less a little for each move${outcome === "timed_out" || outcome === "abandoned" ? "" : " and a fine for the accident"}. Finishing would have added a bonus. ${scale}`;
}

/** @param {GameState} state @param {string} rival @returns what stands below the goal while one board fills the page */
export function standing({ mode, counts, player }, rival) {
  if (mode === "ranked" && player) {
    const what = counts ? "This ranked episode counts from your first move on, however it ends. Leaving it, or a long time without a move, counts as abandoned."
      : "This episode does not count: its terrain was chosen or met before, or a script has moved.";
    return `${what} After the end, ${rival || "a policy"} explores the same terrain beside you.`;
  }
  return "Your lidar uncovers what is in sight. Rocks and the edge of the map end the episode.";
}

/** Return what a screen reader announces after a change: each tenth of the ground, and the end; "" for all else.
 * @param {Frame | null} before @param {Frame} after */
export function announcement(before, after) {
  if (!before || before.episode !== after.episode) return `New terrain, ${after.rows} by ${after.cols}. ${percent(after.coverage)} percent in sight.`;
  if (after.outcome && !before.outcome) {
    return `${ending(after).title.replace("%", "percent")}.${after.score === null ? "" : ` Score ${score(after.score)}.`}`;
  }
  const tenth = Math.floor(after.coverage * 10);
  return tenth > Math.floor(before.coverage * 10) ? `${tenth * 10} percent mapped in ${many(after.step, "move")}.` : "";
}
