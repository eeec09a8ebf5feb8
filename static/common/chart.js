// @ts-check
// Coverage over moves, both curves on one canvas; the step axis grows with the longer of the two.

/**
 * `values[k]` is what the policy expected to earn at step k, in units of its own; not drawn when absent.
 * @typedef {{name: string, colour: string, isDashed: boolean, discovered: number[], cells: number, values?: (number | null)[]}} Curve
 */
/** @typedef {{text: string, goal: string, base: string, line: string}} Inks  of labels, the 99 % line, the axis and the grid */
/** @type {Inks} */
export const INKS = { text: "#a8988d", goal: "#e8ddd3", base: "#5a453a", line: "#2a2023" };

/**
 * The right end of the step axis: a round number with a little room, at least 40.
 * @param {number} steps of the longest curve
 */
export function axisEnd(steps) {
  const wanted = Math.max(40, steps * 1.12);
  const unit = wanted <= 200 ? 20 : wanted <= 1000 ? 100 : 500;
  return Math.ceil(wanted / unit) * unit;
}

/**
 * Distances between labels: at most eight of them.
 * @param {number} end
 */
export function tickStep(end) {
  return [10, 20, 50, 100, 200, 500, 1000, 2000, 5000].find((step) => end / step <= 8) ?? 10000;
}

/**
 * Indices to draw: all of a short curve, an even choice of a long one, always the last.
 * @param {number} count
 * @param {number} most
 */
export function sampled(count, most) {
  const stride = Math.max(1, Math.ceil(count / most));
  const chosen = [];
  for (let index = 0; index < count; index += stride) chosen.push(index);
  if (count > 0 && chosen[chosen.length - 1] !== count - 1) chosen.push(count - 1);
  return chosen;
}

/**
 * @param {HTMLCanvasElement} canvas
 * @param {Curve[]} curves
 * @param {{width_px: number, height_px: number, dpr: number, font: string, inks?: Inks}} look
 */
export function paintChart(canvas, curves, look) {
  const { width_px: width, height_px: height, dpr } = look;
  if (width < 40 || height < 30) return;
  canvas.width = Math.round(width * dpr);
  canvas.height = Math.round(height * dpr);
  canvas.style.width = `${width}px`;
  canvas.style.height = `${height}px`;
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  context.scale(dpr, dpr);
  context.font = `11px ${look.font}`;
  const end = axisEnd(Math.max(0, ...curves.map((curve) => curve.discovered.length - 1)));
  const box = { left: 38, right: width - 14, top: 8, bottom: height - 20 };
  const at = {
    /** @param {number} step */
    x: (step) => box.left + ((box.right - box.left) * step) / end,
    /** @param {number} share */
    y: (share) => box.bottom - (box.bottom - box.top) * share,
  };
  paintAxes(context, box, at, { end, height }, look.inks ?? INKS);
  for (const curve of curves) paintValue(context, curve, at, box.right);
  for (const curve of curves) paintCurve(context, curve, at);
}

/**
 * The lowest and highest of the numbers, a little apart at least; null when there are none.
 * @param {(number | null | undefined)[]} values
 * @returns {[number, number] | null}
 */
export function span(values) {
  const known = values.filter((value) => typeof value === "number");
  if (known.length === 0) return null;
  const [low, high] = [Math.min(...known), Math.max(...known)];
  return high - low < 1e-6 ? [low - 0.5, high + 0.5] : [low, high];
}

/**
 * The value as a fine line between its own lowest and highest, its newest number beside it.
 * @param {CanvasRenderingContext2D} context
 * @param {Curve} curve
 * @param {Scale} at
 * @param {number} right
 */
function paintValue(context, { values = [], colour }, at, right) {
  const range = span(values);
  if (!range) return;
  const y = (/** @type {number} */ value) => at.y(0.04 + (0.86 * (value - range[0])) / (range[1] - range[0]));
  context.beginPath();
  let isDown = false;
  let last = { x: 0, y: 0, value: 0 };
  for (let step = 0; step < values.length; step++) {
    const value = values[step];
    if (typeof value !== "number") { isDown = false; continue; }
    last = { x: at.x(step), y: y(value), value };
    if (isDown) context.lineTo(last.x, last.y);
    else context.moveTo(last.x, last.y);
    isDown = true;
  }
  context.strokeStyle = context.fillStyle = colour;
  context.globalAlpha = 0.75;
  context.lineWidth = 1;
  context.stroke();
  context.globalAlpha = 1;
  context.textAlign = last.x > right - 90 ? "right" : "left";
  context.textBaseline = "middle";
  const number = last.value.toFixed(1).replace("-", "\u2212");
  context.fillText(`value ${number}`, last.x + (last.x > right - 90 ? -7 : 7), Math.min(last.y, at.y(0) - 8));
}

/** @typedef {{x: (step: number) => number, y: (share: number) => number}} Scale */

/**
 * @param {CanvasRenderingContext2D} context
 * @param {{left: number, right: number, top: number, bottom: number}} box
 * @param {Scale} at
 * @param {{end: number, height: number}} size
 * @param {Inks} inks
 */
function paintAxes(context, box, at, { end, height }, inks) {
  context.textBaseline = "middle";
  context.lineWidth = 1;
  for (const share of height > 120 ? [0, 0.25, 0.5, 0.75] : [0, 0.5]) {
    context.strokeStyle = share === 0 ? inks.base : inks.line;
    line(context, box.left, at.y(share), box.right, at.y(share));
    context.fillStyle = inks.text;
    context.textAlign = "right";
    context.fillText(`${share * 100}`, box.left - 8, at.y(share));
  }
  context.setLineDash([2, 4]);
  context.strokeStyle = inks.goal;
  line(context, box.left, at.y(0.99), box.right, at.y(0.99));
  context.setLineDash([]);
  context.fillStyle = inks.goal;
  context.fillText("99 %", box.left - 6, at.y(0.99) + 2);
  context.fillStyle = inks.text;
  context.textBaseline = "alphabetic";
  for (let step = 0, gap = tickStep(end); step <= end; step += gap) {
    context.textAlign = step === 0 ? "left" : step === end ? "right" : "center";
    const hasRoom = at.x(gap) - at.x(0) > 80;
    context.fillText(step === 0 && hasRoom ? "0 moves" : `${step}`, at.x(step), height - 5);
  }
}

/**
 * @param {CanvasRenderingContext2D} context
 * @param {number} x1
 * @param {number} y1
 * @param {number} x2
 * @param {number} y2
 */
function line(context, x1, y1, x2, y2) {
  context.beginPath();
  context.moveTo(x1, Math.round(y1) + 0.5);
  context.lineTo(x2, Math.round(y2) + 0.5);
  context.stroke();
}

/**
 * @param {CanvasRenderingContext2D} context
 * @param {Curve} curve
 * @param {Scale} at
 */
function paintCurve(context, curve, at) {
  const { discovered, cells } = curve;
  if (discovered.length === 0) return;
  context.beginPath();
  for (const step of sampled(discovered.length, 600)) {
    const x = at.x(step);
    const y = at.y(discovered[step] / cells);
    if (step === 0) context.moveTo(x, y);
    else context.lineTo(x, y);
  }
  context.strokeStyle = context.fillStyle = curve.colour;
  context.lineWidth = 2;
  context.lineJoin = "round";
  context.setLineDash(curve.isDashed ? [6, 4] : []);
  context.stroke();
  context.setLineDash([]);
  const last = discovered.length - 1;
  context.beginPath();
  context.arc(at.x(last), at.y(discovered[last] / cells), 3.5, 0, 7);
  context.fill();
}
