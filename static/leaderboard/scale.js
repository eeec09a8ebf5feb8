// @ts-check
// The common scale of the ranks: linear round those near the best; who is far off stands in a piece of their own, after a break.
import { ticks } from "../common/chart_scale.js";

/** Shares of the width that the far piece and the break before it take. */
const FAR = 0.1;
const BREAK = 0.05;

/** Return the scale for some figures: round numbers around everybody near the best, the others apart.
 * @param {Leaderboard.Figure[]} figures @param {Leaderboard.Measure} measure @returns {Leaderboard.Scale} */
export function scaleOf(figures, measure) {
  const isSteps = measure === "steps";
  const means = figures.map((figure) => figure[measure].mean).sort((a, b) => a - b);
  if (means.length === 0) return { near: { low: 0, high: 1, from: 0, to: 1 }, far: null, ticks: [], farTicks: [] };
  const best = isSteps ? means[0] : means[means.length - 1];
  const isNear = (/** @type {Leaderboard.Figure} */ figure) => (isSteps ? figure.steps.mean <= 2.5 * best : figure.score.mean >= best - 0.3);
  const [low, high] = rangeOf(figures.filter(isNear), measure);
  const others = figures.filter((figure) => !isNear(figure));
  if (others.length === 0) return { near: { low, high, from: 0, to: 1 }, far: null, ticks: ticks(low, high), farTicks: [] };
  const [least, most] = rangeOf(others, measure);
  const [near, far] = isSteps ? [{ from: 0, to: 1 - FAR - BREAK }, { from: 1 - FAR, to: 1 }] : [{ from: FAR + BREAK, to: 1 }, { from: 0, to: FAR }];
  return { near: { low, high, ...near }, far: { low: least, high: most, ...far }, ticks: ticks(low, high), farTicks: farTicks(others.map((figure) => figure[measure].mean), isSteps) };
}

/** Return the range of some figures with their intervals, and a little room.
 * @param {Leaderboard.Figure[]} figures @param {Leaderboard.Measure} measure @returns {[number, number]} */
function rangeOf(figures, measure) {
  const values = figures.map((figure) => figure[measure]);
  const least = Math.min(...values.map(({ low, mean }) => low ?? mean));
  const most = Math.max(...values.map(({ high, mean }) => high ?? mean));
  const room = Math.max((most - least) * 0.08, measure === "steps" ? 2 : 0.005);
  return [least - room, most + room];
}

/** Return the numbers under the far piece: one, or the least and the most where they stand apart.
 * @param {number[]} means @param {boolean} isSteps */
function farTicks(means, isSteps) {
  const round = (/** @type {number} */ mean) => (isSteps ? Math.round(mean) : Number(mean.toFixed(2)));
  const [least, most] = [Math.min(...means), Math.max(...means)].map(round);
  return most - least > 0.1 * Math.abs(most) ? [least, most] : [round(means.reduce((sum, mean) => sum + mean, 0) / means.length)];
}

/** Return where a value stands, as a share 0..1 of the width; null where it is on neither piece.
 * @param {Leaderboard.Scale} scale @param {number} value */
export function placeOf({ near, far }, value) {
  const piece = [near, far].find((each) => each && value >= each.low && value <= each.high);
  return piece ? piece.from + ((value - piece.low) / (piece.high - piece.low)) * (piece.to - piece.from) : null;
}

/** Return the strip in which the axis is broken, as shares of the width; null where it is whole.
 * @param {Leaderboard.Scale} scale */
export function breakOf({ near, far }) {
  return far && { from: Math.min(near.to, far.to), to: Math.max(near.from, far.from) };
}
