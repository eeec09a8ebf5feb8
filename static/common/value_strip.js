// @ts-check
// What policies expect to earn from here on, over moves: a strip below the coverage chart with an axis of its own.
import { drawDot, drawGrid, drawLine, openChart } from "./chart.js";
import { linearScale, span, tickText, ticks } from "./chart_scale.js";

/** Return the sentence under which the strip stands; "" while no policy says what it expects.
 * @param {string[]} names of the policies drawn */
export function valueLine(names) {
  return names.length ? `What ${names.join(" and ")} expects to earn from here on, in the points of its training: new ground earns, moves cost` : "";
}

/** Return the values at which the strip has a line and a number: its ends, and nought where that lies well between
 * them.
 * @param {[number, number]} range */
export function stripTicks([low, high]) {
  const found = ticks(low, high);
  const ends = [found[0], found[found.length - 1]];
  const isBetween = (/** @type {number} */ tick) => Math.min(tick - ends[0], ends[1] - tick) > 0.4 * (ends[1] - ends[0]);
  return [...new Set(found.length < 2 ? found : [ends[0], ...found.filter((tick) => tick === 0 && isBetween(tick)), ends[1]])];
}

/** @param {HTMLCanvasElement} canvas @param {ValueCurve[]} curves
 * @param {ChartSize & {inks: Inks, end: number}} look end: of the step axis, in moves */
export function paintValues(canvas, curves, look) {
  const { width_px: width, height_px: height, inks, end } = look;
  if (width < 40 || height < 20) return;
  const context = openChart(canvas, look);
  const range = span(curves.flatMap(({ values }) => values));
  if (!range) return;
  const box = { left: 38, right: width - 14, top: 7, bottom: height - 7 };
  const marks = stripTicks(range);
  const low = Math.min(range[0], ...marks);
  const high = Math.max(range[1], ...marks);
  const at = linearScale(box, { low: 0, high: end }, { low, high });
  const hasNought = low < 0 && high > 0 && !marks.includes(0);
  drawGrid(context, box, at, [...marks.map((tick) => ({ at: tick, text: tickText(tick) })), ...(hasNought ? [{ at: 0, text: "" }] : [])], { inks, base: low < 0 && high > 0 ? 0 : low });
  for (const { values, colour, isDashed } of curves) {
    // A page that skipped a frame has no value for it: the line goes on to the next one.
    const points = Array.from(values, (value, step) => (typeof value === "number" ? [{ x: at.x(step), y: at.y(value) }] : [])).flat();
    drawLine(context, points, { colour, width: 1.75, dashes: isDashed ? [6, 4] : [] });
    if (points.length) drawDot(context, points[points.length - 1], 3, colour);
  }
}
