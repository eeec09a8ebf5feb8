// @ts-check
// The scrubber: coverage over moves of both runs, bright as far as the replay has come, and the pointer on it.
import { drawDot, drawGoal, drawGrid, drawLabel, drawLine, openChart } from "../common/chart.js";
import { linearScale, sampled, tickStep } from "../common/chart_scale.js";
import { clamped, coverageAt, movesOf } from "../common/player.js";

const GOAL = 0.99;
const MAX_POINTS = 800;

/** Return the box that the curves are drawn in, in CSS pixels.
 * @param {number} width_px @param {number} height_px @returns {Box} */
export const plotBox = (width_px, height_px) => ({ left: 42, right: Math.max(43, width_px - 14), top: 10, bottom: Math.max(11, height_px - 22) });

/** Return the move at a place of the picture: the nearest one, the first or last outside the box.
 * @param {number} x_px @param {Box} box @param {number} last */
export function stepAt(x_px, { left, right }, last) {
  return Math.max(0, Math.min(last, Math.round((last * (x_px - left)) / (right - left))));
}

/** @param {HTMLCanvasElement} canvas @param {ReplayLine[]} lines the episode's own first
 * @param {{step: number, last: number}} where @param {ChartSize & {inks: Inks}} look */
export function paintCurve(canvas, lines, { step, last }, look) {
  const { width_px, height_px, inks } = look;
  if (width_px < 60 || height_px < 40) return;
  const context = openChart(canvas, look);
  const box = plotBox(width_px, height_px);
  const at = linearScale(box, { low: 0, high: Math.max(1, last) }, { low: 0, high: 1 });
  const shares = height_px > 110 ? [0, 0.25, 0.5, 0.75] : [0, 0.5];
  drawGrid(context, box, at, shares.map((share) => ({ at: share, text: `${share * 100} %` })), { inks, base: 0 });
  drawGoal(context, box, at.y(GOAL), inks.goal);
  context.textAlign = "right";
  context.textBaseline = "middle";
  context.fillStyle = inks.goal;
  context.fillText("99 %", box.left - 6, at.y(GOAL) + 2);
  const gap = tickStep(Math.max(1, last));
  const zero = at.x(gap) - at.x(0) > 80 ? "0 moves" : "0";
  for (let move = 0; move <= last; move += gap) drawLabel(context, move === 0 ? zero : `${move}`, { x: at.x(move), y: height_px - 5 }, move === 0 ? "left" : "center", inks.text);
  for (const line of [...lines].reverse()) paintLine(context, line, at, step);
  context.beginPath();
  context.moveTo(at.x(step), box.top - 6);
  context.lineTo(at.x(step), box.bottom);
  context.strokeStyle = inks.goal;
  context.lineWidth = 1.5;
  context.stroke();
  for (const { course, colour } of [...lines].reverse()) drawDot(context, { x: at.x(clamped(course, step)), y: at.y(coverageAt(course, step)) }, 4.5, colour);
}

/** @param {CanvasRenderingContext2D} context @param {ReplayLine} line @param {Scale} at @param {number} step */
function paintLine(context, { course, colour, isDashed }, at, step) {
  const point = (/** @type {number} */ move) => ({ x: at.x(move), y: at.y(coverageAt(course, move)) });
  const whole = sampled(movesOf(course) + 1, MAX_POINTS).map(point);
  drawLine(context, whole, { colour, dashes: isDashed ? [6, 4] : [], alpha: 0.42 });
  drawDot(context, whole[whole.length - 1], 2.5, colour);
  const done = sampled(clamped(course, step) + 1, MAX_POINTS).map(point);
  drawLine(context, done, { colour, width: 3, dashes: isDashed ? [6, 4] : [] });
}

/** Let the pointer go through a replay: hovering shows a move, pressing goes there, dragging goes along.
 * @param {HTMLElement} root
 * @param {{last: () => number, onMove: (step: number) => void, onHover: (step: number | null) => void}} how */
export function startScrubber(root, { last, onMove, onHover }) {
  /** @param {PointerEvent} event */
  function at({ clientX }) {
    const { left, width, height } = root.getBoundingClientRect();
    return stepAt(clientX - left, plotBox(width, height), last());
  }
  let isDragged = false;
  root.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    isDragged = true;
    root.setPointerCapture(event.pointerId);
    root.focus({ preventScroll: true });
    onMove(at(event));
  });
  root.addEventListener("pointermove", (event) => {
    if (isDragged) onMove(at(event));
    else if (event.pointerType === "mouse") onHover(at(event));
  });
  const drop = () => { isDragged = false; };
  root.addEventListener("pointerup", drop);
  root.addEventListener("pointercancel", drop);
  root.addEventListener("pointerleave", () => { if (!isDragged) onHover(null); });
}
