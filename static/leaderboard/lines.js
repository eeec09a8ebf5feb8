// @ts-check
// Lines with bands, as SVG: coverage against moves, trials. Widths are the element's own, so text stays text-sized.

/**
 * @typedef {{name: string, colour: string, dash: string, x: number[], y: number[], low: (number | null)[], high: (number | null)[], dots?: boolean}} Line  `dots`: points with whiskers for a band
 */
/** @typedef {{low: number, high: number, ticks: number[], text: (value: number) => string, title: string}} Axis */

const SVG = "http://www.w3.org/2000/svg";

/**
 * @param {string} kind
 * @param {Record<string, string | number>} attributes
 * @param {string} [text]
 */
export function shape(kind, attributes, text) {
  const element = document.createElementNS(SVG, kind);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
  if (text !== undefined) element.textContent = text;
  return element;
}

/**
 * @param {SVGSVGElement} svg
 * @param {Line[]} lines those drawn last stand in front
 * @param {{x: Axis, y: Axis, goal?: number, label: string}} how
 */
export function paintLines(svg, lines, { x, y, goal, label }) {
  const { width, height } = svg.getBoundingClientRect();
  if (width < 60 || height < 60) return;
  const box = { left: 44, right: width - 12, top: 10, bottom: height - 34 };
  const at = {
    x: (/** @type {number} */ value) => box.left + ((box.right - box.left) * (value - x.low)) / (x.high - x.low || 1),
    y: (/** @type {number} */ value) => box.bottom - ((box.bottom - box.top) * (value - y.low)) / (y.high - y.low || 1),
  };
  const clip = shape("clipPath", { id: `${svg.id}-box` });
  clip.append(shape("rect", { x: box.left, y: box.top - 6, width: box.right - box.left + 4, height: box.bottom - box.top + 8 }));
  const inside = shape("g", { "clip-path": `url(#${svg.id}-box)` });
  for (const line of lines) inside.append(...drawn(line, at));
  svg.setAttribute("aria-label", label);
  svg.replaceChildren(clip, ...axes(box, at, x, y), inside);
  if (goal !== undefined) svg.append(shape("line", { class: "goal", x1: box.left, x2: box.right, y1: at.y(goal), y2: at.y(goal) }));
}

/**
 * @typedef {{left: number, right: number, top: number, bottom: number}} Box
 * @typedef {{x: (value: number) => number, y: (value: number) => number}} Scale
 */

/**
 * @param {Box} box
 * @param {Scale} at
 * @param {Axis} x
 * @param {Axis} y
 */
function axes(box, at, x, y) {
  const found = y.ticks.flatMap((tick) => [
    shape("line", { class: "grid", x1: box.left, x2: box.right, y1: at.y(tick), y2: at.y(tick) }),
    shape("text", { x: box.left - 8, y: at.y(tick) + 4, "text-anchor": "end" }, y.text(tick)),
  ]);
  found.push(shape("line", { class: "axis", x1: box.left, x2: box.right, y1: box.bottom, y2: box.bottom }));
  for (const tick of x.ticks) found.push(shape("text", { x: at.x(tick), y: box.bottom + 16, "text-anchor": "middle" }, x.text(tick)));
  found.push(shape("text", { x: box.right, y: box.bottom + 31, "text-anchor": "end" }, x.title));
  return found;
}

/**
 * @param {Line} line
 * @param {Scale} at
 */
function drawn({ colour, dash, x, y, low, high, dots }, at) {
  const point = (/** @type {number} */ value, /** @type {number} */ k) => `${at.x(x[k]).toFixed(1)} ${at.y(value).toFixed(1)}`;
  const line = shape("path", { class: "line", d: `M${y.map(point).join("L")}`, stroke: colour, "stroke-dasharray": dash });
  if (dots) return [...whiskers(x, low, high, at, colour), line, ...y.map((value, k) => shape("circle", { cx: at.x(x[k]), cy: at.y(value), r: 3.2, fill: colour }))];
  if (low.length === 0) return [line];
  const round = [...low.map((value, k) => point(Number(value), k)), ...high.map((value, k) => point(Number(value), k)).reverse()];
  return [shape("path", { class: "band", d: `M${round.join("L")}Z`, fill: colour }), line];
}

/**
 * @param {number[]} x
 * @param {(number | null)[]} low
 * @param {(number | null)[]} high
 * @param {Scale} at
 * @param {string} colour
 */
function whiskers(x, low, high, at, colour) {
  return x.flatMap((value, k) => {
    const [from, to] = [low[k], high[k]];
    if (from === null || to === null) return [];
    return [shape("line", { class: "whisker", x1: at.x(value), x2: at.x(value), y1: at.y(from), y2: at.y(to), stroke: colour })];
  });
}

/**
 * The key of a chart.
 * @param {HTMLElement} place
 * @param {{name: string, colour: string, dash: string}[]} lines
 */
export function paintLegend(place, lines) {
  place.replaceChildren(...lines.map(({ name, colour, dash }) => {
    const item = document.createElement("span");
    const svg = shape("svg", { viewBox: "0 0 22 8" });
    svg.append(shape("line", { x1: 0, x2: 22, y1: 4, y2: 4, stroke: colour, "stroke-width": 3, "stroke-dasharray": dash }));
    item.append(svg, name);
    return item;
  }));
}
