// @ts-check
// Coverage over moves, the curves of all boards on one canvas; the step axis grows with the longest of them.
import { drawDot, drawGoal, drawGrid, drawLabel, drawLine, openChart } from "./chart.js";
import { chartColours } from "./colours.js";
import { axisEnd, linearScale, sampled, span, tickStep } from "./chart_scale.js";

/**
 * `values[k]` is what the policy expected to earn at step k, in units of its own; not drawn when absent.
 * @typedef {{name: string, colour: string, isDashed: boolean, discovered: number[], cells: number, values?: (number | null)[]}} Curve
 * @typedef {import("./chart.js").Inks} Inks
 * @typedef {import("./chart_scale.js").Scale} Scale
 */

const GOAL = 0.99;
/** Points of a curve that are drawn at most. */
const MAX_POINTS = 600;

/**
 * Return the curve of a board.
 * @param {import("./game_state.js").Board} board
 * @param {{colour: string, isDashed: boolean, hasValues: boolean}} look
 * @returns {Curve}
 */
export function curveOf({ name, discovered, frame, values = [] }, { colour, isDashed, hasValues }) {
  return { name, colour, isDashed, discovered, cells: frame.rows * frame.cols, values: hasValues ? values : [] };
}

/**
 * @param {HTMLCanvasElement} canvas
 * @param {Curve[]} curves
 * @param {import("./chart.js").ChartSize & {inks?: Inks}} look
 */
export function paintCoverage(canvas, curves, look) {
  const { width_px: width, height_px: height, inks = chartColours(canvas).inks } = look;
  if (width < 40 || height < 30) return;
  const context = openChart(canvas, look);
  const end = axisEnd(Math.max(0, ...curves.map((curve) => curve.discovered.length - 1)));
  const box = { left: 38, right: width - 14, top: 8, bottom: height - 20 };
  const at = linearScale(box, { low: 0, high: end }, { low: 0, high: 1 });
  const shares = height > 120 ? [0, 0.25, 0.5, 0.75] : [0, 0.5];
  drawGrid(context, box, at, shares.map((share) => ({ at: share, text: `${share * 100}` })), { inks, base: 0 });
  drawGoal(context, box, at.y(GOAL), inks.goal);
  context.textBaseline = "middle";
  context.fillStyle = inks.goal;
  context.fillText("99 %", box.left - 6, at.y(GOAL) + 2);
  drawSteps(context, at, end, height - 5, inks);
  for (const curve of curves) drawValue(context, curve, at, box.right);
  for (const curve of curves) drawCurve(context, curve, at);
}

/**
 * @param {CanvasRenderingContext2D} context
 * @param {Scale} at
 * @param {number} end of the axis, in moves
 * @param {number} y
 * @param {Inks} inks
 */
function drawSteps(context, at, end, y, inks) {
  const gap = tickStep(end);
  const hasRoom = at.x(gap) - at.x(0) > 80;
  for (let step = 0; step <= end; step += gap) {
    const align = step === 0 ? "left" : step === end ? "right" : "center";
    drawLabel(context, step === 0 && hasRoom ? "0 moves" : `${step}`, { x: at.x(step), y }, align, inks.text);
  }
}

/**
 * Draw the value as a fine line between its own lowest and highest, its newest number at its end.
 * @param {CanvasRenderingContext2D} context
 * @param {Curve} curve
 * @param {Scale} at
 * @param {number} right
 */
function drawValue(context, { values = [], colour }, at, right) {
  const range = span(values);
  if (!range) return;
  const y = (/** @type {number} */ value) => at.y(0.04 + (0.86 * (value - range[0])) / (range[1] - range[0]));
  let last = { x: 0, y: 0, value: 0 };
  const points = Array.from(values, (value, step) => {
    if (typeof value !== "number") return null;
    last = { x: at.x(step), y: y(value), value };
    return last;
  });
  drawLine(context, points, { colour, width: 1, alpha: 0.75 });
  context.fillStyle = colour;
  context.textAlign = last.x > right - 90 ? "right" : "left";
  context.textBaseline = "middle";
  const number = last.value.toFixed(1).replace("-", "\u2212");
  context.fillText(`value ${number}`, last.x + (last.x > right - 90 ? -7 : 7), Math.min(last.y, at.y(0) - 8));
}

/**
 * @param {CanvasRenderingContext2D} context
 * @param {Curve} curve
 * @param {Scale} at
 */
function drawCurve(context, { discovered, cells, colour, isDashed }, at) {
  if (discovered.length === 0) return;
  const points = sampled(discovered.length, MAX_POINTS).map((step) => ({ x: at.x(step), y: at.y(discovered[step] / cells) }));
  drawLine(context, points, { colour, dashes: isDashed ? [6, 4] : [] });
  drawDot(context, points[points.length - 1], 3.5, colour);
}
