// @ts-check
// What every chart draws with: a canvas that is crisp at any pixel ratio, axes, lines, bands, dots, and the legend.

/** Dashes of the line that marks 99 %. */
const GOAL_DASHES = [2, 4];

/** Return the context of a cleared canvas of this size, ready to draw in CSS pixels.
 * @param {HTMLCanvasElement} canvas @param {ChartSize} size */
export function openChart(canvas, { width_px, height_px, dpr, font }) {
  canvas.width = Math.round(width_px * dpr);
  canvas.height = Math.round(height_px * dpr);
  canvas.style.width = `${width_px}px`;
  canvas.style.height = `${height_px}px`;
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  context.scale(dpr, dpr);
  context.font = `11px ${font}`;
  return context;
}

/** Draw a horizontal line, one crisp pixel high.
 * @param {CanvasRenderingContext2D} context @param {Box} box @param {number} y @param {string} colour
 * @param {number[]} [dashes] */
function rule(context, box, y, colour, dashes = []) {
  context.beginPath();
  context.moveTo(box.left, Math.round(y) + 0.5);
  context.lineTo(box.right, Math.round(y) + 0.5);
  context.setLineDash(dashes);
  context.strokeStyle = colour;
  context.lineWidth = 1;
  context.stroke();
  context.setLineDash([]);
}

/** Draw the grid with its numbers at the left, and the axis.
 * @param {CanvasRenderingContext2D} context @param {Box} box @param {Scale} at
 * @param {{at: number, text: string}[]} marks values on the y axis
 * @param {{inks: Inks, base?: number}} look base: the value whose line is the axis itself */
export function drawGrid(context, box, at, marks, { inks, base }) {
  context.textAlign = "right";
  context.textBaseline = "middle";
  for (const mark of marks) {
    rule(context, box, at.y(mark.at), mark.at === base ? inks.base : inks.line);
    context.fillStyle = inks.text;
    context.fillText(mark.text, box.left - 8, at.y(mark.at));
  }
  if (!marks.some((mark) => mark.at === base)) rule(context, box, box.bottom, inks.base);
}

/** Draw the dashed line of the goal.
 * @param {CanvasRenderingContext2D} context @param {Box} box @param {number} y @param {string} colour */
export function drawGoal(context, box, y, colour) {
  rule(context, box, y, colour, GOAL_DASHES);
}

/** Draw a number or a title below the chart.
 * @param {CanvasRenderingContext2D} context @param {string} text @param {Point} point of its base line
 * @param {CanvasTextAlign} align @param {string} colour */
export function drawLabel(context, text, { x, y }, align, colour) {
  context.textAlign = align;
  context.textBaseline = "alphabetic";
  context.fillStyle = colour;
  context.fillText(text, x, y);
}

/** Draw a line through points; a null breaks it.
 * @param {CanvasRenderingContext2D} context @param {(Point | null)[]} points
 * @param {{colour: string, width?: number, dashes?: number[], alpha?: number}} look */
export function drawLine(context, points, { colour, width = 2, dashes = [], alpha = 1 }) {
  context.beginPath();
  let isDown = false;
  for (const point of points) {
    if (point && isDown) context.lineTo(point.x, point.y);
    else if (point) context.moveTo(point.x, point.y);
    isDown = point !== null;
  }
  context.strokeStyle = colour;
  context.globalAlpha = alpha;
  context.lineWidth = width;
  context.lineJoin = "round";
  context.setLineDash(dashes);
  context.stroke();
  context.setLineDash([]);
  context.globalAlpha = 1;
}

/** Draw the band between two lines.
 * @param {CanvasRenderingContext2D} context @param {Point[]} lower @param {Point[]} upper @param {string} colour */
export function drawBand(context, lower, upper, colour) {
  context.beginPath();
  for (const { x, y } of [...lower, ...[...upper].reverse()]) context.lineTo(x, y);
  context.closePath();
  context.fillStyle = colour;
  context.globalAlpha = 0.16;
  context.fill();
  context.globalAlpha = 1;
}

/** @param {CanvasRenderingContext2D} context @param {Point} point @param {number} radius @param {string} colour */
export function drawDot(context, { x, y }, radius, colour) {
  context.beginPath();
  context.arc(x, y, radius, 0, 7);
  context.fillStyle = colour;
  context.fill();
}

/** Paint the legend of a chart, if it is another one: each name after a piece of its line.
 * @param {HTMLElement} place @param {{name: string, colour: string, dash: string}[]} lines */
export function paintLegend(place, lines) {
  const painted = JSON.stringify(lines);
  if (place.dataset.painted === painted) return;
  place.dataset.painted = painted;
  place.replaceChildren(...lines.map(({ name, colour, dash }) => {
    const item = document.createElement("span");
    const svg = shape("svg", { viewBox: "0 0 22 8" });
    svg.append(shape("line", { x1: "0", x2: "22", y1: "4", y2: "4", stroke: colour, "stroke-width": "3", "stroke-dasharray": dash }));
    item.append(svg, name);
    return item;
  }));
}

/** @param {string} kind @param {Record<string, string>} attributes */
function shape(kind, attributes) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", kind);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  return element;
}
