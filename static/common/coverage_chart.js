// @ts-check
// Coverage over moves, the curves of all boards on one canvas; the step axis grows with the longest of them.
import { drawDot, drawGoal, drawGrid, drawLabel, drawLine, openChart } from "./chart.js";
import { chartColours } from "./colours.js";
import { axisEnd, linearScale, sampled, tickStep } from "./chart_scale.js";

const GOAL = 0.99;
/** Points of a curve that are drawn at most. */
const MAX_POINTS = 600;

/** @param {Board} board @param {{colour: string, isDashed: boolean}} look @returns {Curve} the curve of a board */
export function curveOf({ name, discovered, frame }, { colour, isDashed }) {
  return { name, colour, isDashed, discovered, cells: frame.cells };
}

/** @param {Curve[]} curves @returns the right end of the step axis of some curves, in moves */
export const stepsEnd = (curves) => axisEnd(Math.max(0, ...curves.map((curve) => curve.discovered.length - 1)));

/** Paint the curves; return the chart's scale and its context for whatever is drawn over them, null where there is no
 * room.
 * @param {HTMLCanvasElement} canvas @param {Curve[]} curves @param {ChartSize & {inks?: Inks}} look
 * @returns {{at: Scale, context: CanvasRenderingContext2D} | null} */
export function paintCoverage(canvas, curves, look) {
  const { width_px: width, height_px: height, inks = chartColours(canvas).inks } = look;
  if (width < 40 || height < 30) return null;
  const context = openChart(canvas, look);
  const end = stepsEnd(curves);
  const box = { left: 38, right: width - 14, top: 8, bottom: height - 20 };
  const at = linearScale(box, { low: 0, high: end }, { low: 0, high: 1 });
  const shares = height > 120 ? [0, 0.25, 0.5, 0.75] : [0, 0.5];
  drawGrid(context, box, at, shares.map((share) => ({ at: share, text: `${share * 100}` })), { inks, base: 0 });
  drawGoal(context, box, at.y(GOAL), inks.goal);
  context.textBaseline = "middle";
  context.fillStyle = inks.goal;
  context.fillText("99 %", box.left - 6, at.y(GOAL) + 2);
  drawSteps(context, at, end, height - 5, inks);
  for (const curve of curves) drawCurve(context, curve, at);
  return { at, context };
}

/** @param {CanvasRenderingContext2D} context @param {Scale} at @param {number} end of the axis, in moves
 * @param {number} y @param {Inks} inks */
function drawSteps(context, at, end, y, inks) {
  const gap = tickStep(end);
  const hasRoom = at.x(gap) - at.x(0) > 80;
  for (let step = 0; step <= end; step += gap) {
    const align = step === 0 ? "left" : step === end ? "right" : "center";
    drawLabel(context, step === 0 && hasRoom ? "0 moves" : `${step}`, { x: at.x(step), y }, align, inks.text);
  }
}

/** @param {CanvasRenderingContext2D} context @param {Curve} curve @param {Scale} at */
function drawCurve(context, { discovered, cells, colour, isDashed }, at) {
  if (discovered.length === 0) return;
  const points = sampled(discovered.length, MAX_POINTS).map((step) => ({ x: at.x(step), y: at.y(discovered[step] / cells) }));
  drawLine(context, points, { colour, dashes: isDashed ? [6, 4] : [] });
  drawDot(context, points[points.length - 1], 3.5, colour);
}
