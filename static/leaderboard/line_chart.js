// @ts-check
// Lines with bands or whiskers on a canvas: coverage against moves, trials.
import { drawBand, drawDot, drawGoal, drawGrid, drawLabel, drawLine, openChart } from "../common/chart.js";
import { chartColours } from "../common/colours.js";
import { linearScale } from "../common/chart_scale.js";

/** @param {HTMLCanvasElement} canvas it fills its parent
 * @param {Leaderboard.Line[]} lines those drawn last stand in front
 * @param {{x: Leaderboard.Axis, y: Leaderboard.Axis, goal?: number, label: string}} how */
export function paintLines(canvas, lines, { x, y, goal, label }) {
  canvas.setAttribute("aria-label", label);
  const { clientWidth: width_px, clientHeight: height_px } = /** @type {HTMLElement} */ (canvas.parentElement);
  if (width_px < 60 || height_px < 60) return;
  const { inks, font } = chartColours(canvas);
  const context = openChart(canvas, { width_px, height_px, dpr: window.devicePixelRatio || 1, font });
  const box = { left: 44, right: width_px - 12, top: 10, bottom: height_px - 34 };
  const at = linearScale(box, x, y);
  drawGrid(context, box, at, y.ticks.map((tick) => ({ at: tick, text: y.text(tick) })), { inks });
  for (const tick of x.ticks) drawLabel(context, x.text(tick), { x: at.x(tick), y: box.bottom + 16 }, "center", inks.text);
  drawLabel(context, x.title, { x: box.right, y: box.bottom + 31 }, "right", inks.text);
  context.save();
  context.beginPath();
  context.rect(box.left, box.top - 6, box.right - box.left + 4, box.bottom - box.top + 8);
  context.clip();
  for (const line of lines) drawSeries(context, line, at);
  context.restore();
  if (goal !== undefined) drawGoal(context, box, at.y(goal), inks.goal);
}

/** @param {CanvasRenderingContext2D} context @param {Leaderboard.Line} line @param {Scale} at */
function drawSeries(context, { colour, dash, x, y, low, high, hasDots }, at) {
  const points = (/** @type {(number | null)[]} */ values) => values.map((value, k) => ({ x: at.x(x[k]), y: at.y(Number(value)) }));
  if (hasDots) drawWhiskers(context, { colour, x, low, high }, at);
  else if (low.length > 0) drawBand(context, points(low), points(high), colour);
  drawLine(context, points(y), { colour, dashes: dash ? dash.split(" ").map(Number) : [] });
  if (hasDots) for (const point of points(y)) drawDot(context, point, 3.2, colour);
}

/** @param {CanvasRenderingContext2D} context @param {Pick<Leaderboard.Line, "colour" | "x" | "low" | "high">} line
 * @param {Scale} at */
function drawWhiskers(context, { colour, x, low, high }, at) {
  x.forEach((value, k) => {
    const [from, to] = [low[k], high[k]];
    if (from === null || to === null) return;
    drawLine(context, [{ x: at.x(value), y: at.y(from) }, { x: at.x(value), y: at.y(to) }], { colour, alpha: 0.45 });
  });
}
