// Where numbers stand on a chart: ends of axes and ticks. No document here, so that node can test it.

/** Return the next round number: a multiple of 20, 100 or 500, as the axis is long.
 * @param {number} value @param {number} length that decides which of the three */
export function roundUp(value, length) {
  const unit = length <= 200 ? 20 : length <= 1000 ? 100 : 500;
  return Math.ceil(value / unit) * unit;
}

/** Return the right end of the step axis: a round number with a little room, at least 40.
 * @param {number} steps of the longest curve */
export function axisEnd(steps) {
  const wanted = Math.max(40, steps * 1.12);
  return roundUp(wanted, wanted);
}

/** @param {number} end @returns the distance between the labels of the step axis: at most eight of them */
export const tickStep = (end) => [10, 20, 50, 100, 200, 500, 1000, 2000, 5000].find((step) => end / step <= 8) ?? 10000;

/** @param {number} low @param {number} high @returns at most six round numbers that span low..high */
export function ticks(low, high) {
  const rough = (high - low) / 5 || 1;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((each) => each >= rough) ?? rough;
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + step * 1e-9; k++) found.push(Number((k * step).toPrecision(12)));
  return found;
}

/** @param {number} tick @returns a round number as it stands at an axis */
export const tickText = (tick) => String(Number(tick.toFixed(4))).replace("-", "\u2212");

/** Return the lowest and highest of the numbers, a little apart at least; null when there are none.
 * @param {(number | null | undefined)[]} values @returns {[number, number] | null} */
export function span(values) {
  const known = /** @type {number[]} */ (values.filter((value) => Number.isFinite(value)));
  if (known.length === 0) return null;
  const [low, high] = [Math.min(...known), Math.max(...known)];
  return high - low < 1e-6 ? [low - 0.5, high + 0.5] : [low, high];
}

/** @param {number} end @param {string} [unit] @returns {ChartAxis} an axis of moves, with at most eight numbers */
export function movesAxis(end, unit = "moves") {
  const gap = tickStep(Math.max(1, end));
  const found = Array.from({ length: Math.floor(end / gap) + 1 }, (_, k) => k * gap);
  return { low: 0, high: Math.max(1, end), ticks: found, text: (move) => (move ? String(move) : `0 ${unit}`) };
}
/** @param {number} height_px @returns {ChartAxis} an axis of shares, in percent */
export function axisOfShares(height_px) {
  return { low: 0, high: 1, ticks: height_px > 110 ? [0, 0.25, 0.5, 0.75] : [0, 0.5], text: (share) => `${share * 100} %` };
}
