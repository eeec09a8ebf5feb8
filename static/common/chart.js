// Every line chart of the page. uPlot draws axes, lines and bands; dots, whiskers and the goal are drawn over them.
import uPlot from "../vendor/uplot/uPlot.js";
import { axisEnd, movesAxis } from "./chart_scale.js";
import { create, createSvg } from "./page.js";

/** Dashes of a policy's line beside a player's. */
const DASHES = [6, 4];
/** @type {WeakMap<HTMLElement, {key: string, chart: uPlot, how: ChartLook}>} */
const charts = new WeakMap();

/** Paint a chart to fill an element; what is there already is drawn anew where only numbers have changed.
 * @param {HTMLElement} place @param {ChartLook} how */
export function paintChart(place, how) {
  const { clientWidth: width, clientHeight: height } = place;
  if (width < 60 || height < 20) return;
  const looks = how.lines.map((line) => [line.colour, line.dash, line.width, line.alpha, line.isColumns, hasBand(line)]);
  const key = JSON.stringify([how.inks, how.font, how.edges, how.title, looks]);
  const found = charts.get(place);
  if (found?.key === key) {
    found.how = how;
    if (found.chart.width !== width || found.chart.height !== height) found.chart.setSize({ width, height });
    found.chart.setData(columns(how));
    return;
  }
  found?.chart.destroy();
  const made = { key, how };
  const chart = new uPlot({ width, height, ...options(how, () => made.how) }, columns(how), place);
  charts.set(place, Object.assign(made, { chart }));
}

/** Return what uPlot draws on one axis of steps: the goal's line, then each line with its band.
 * @param {ChartLook} how @returns {uPlot.AlignedData} */
function columns({ lines, x, y, goal }) {
  /** @type {uPlot.AlignedData} */
  const frame = [[x.low, x.high], Array(2).fill(goal?.at ?? y.low)];
  return uPlot.join([frame, ...lines.map((line) => /** @type {uPlot.AlignedData} */ (
    hasBand(line) ? [line.x, line.high, line.low, line.y] : [line.x, line.y.map((y) => (Number.isNaN(y) ? null : y))]))]);
}
/** @param {ChartLine} line */
const hasBand = ({ low, hasWhiskers }) => Boolean(low?.length) && !hasWhiskers;

/** @param {ChartLook} how @param {() => ChartLook} now the newest look, of the same lines
 * @returns {Omit<uPlot.Options, "width" | "height">} */
function options({ lines, inks, font, edges, title, goal }, now) {
  const face = `11px ${font}`;
  const points = { show: false };
  const text = { stroke: inks.text, font: face, ticks: { show: false } };
  /** @type {uPlot.Series[]} */
  const series = [{}, { stroke: !goal ? "transparent" : inks.goal, width: 1, dash: [2, 4], points }];
  /** @type {uPlot.Band[]} */
  const bands = [];
  for (const line of lines) {
    if (hasBand(line)) {
      bands.push({ series: [series.length, series.length + 1], fill: line.colour });
      for (const alpha of [0.16, 1]) series.push({ stroke: "transparent", width: 0, alpha, spanGaps: true, points });
    }
    const { colour, width = 2, dash, alpha } = line;
    const paths = line.isColumns ? { paths: uPlot.paths.bars?.({ size: [0.92] }), fill: colour } : {};
    series.push({ stroke: colour, width, dash, alpha, spanGaps: true, points, ...paths });
  }
  return {
    series, bands, legend: { show: false }, cursor: { show: false },
    padding: [edges.top, edges.right, edges.bottom ? 0 : edges.top, 0],
    scales: {
      x: { time: false, range: () => [now().x.low, now().x.high] },
      y: { range: () => [now().y.low, now().y.high] },
    },
    axes: [
      { ...text, show: edges.bottom > 0, size: edges.bottom - (title ? 16 : 0), gap: 7, grid: { show: false },
        splits: () => now().x.ticks, values: (_, ticks) => ticks.map(now().x.text),
        ...(title ? { label: title, labelSize: 16, labelFont: face } : {}) },
      { ...text, size: edges.left, gap: 8, grid: { stroke: inks.line, width: 1 }, splits: () => now().y.ticks,
        values: (_, ticks) => ticks.map(now().y.text) },
    ],
    hooks: { drawAxes: [(chart) => drawBase(chart, now())], draw: [(chart) => drawOver(chart, now())] },
  };
}

/** @param {uPlot} chart @param {ChartLook} how */
function drawBase(chart, { inks, y, base = y.low }) {
  const { ctx: context, bbox } = chart;
  context.fillStyle = inks.base;
  context.fillRect(bbox.left, Math.round(chart.valToPos(base, "y", true)), bbox.width, Math.round(uPlot.pxRatio));
}

/** @param {uPlot} chart @param {ChartLook} how */
function drawOver(chart, { lines, y: { low: least, high: most }, inks, font, edges, goal, over }) {
  const { ctx: context, bbox } = chart;
  const left = bbox.left / uPlot.pxRatio;
  const top = bbox.top / uPlot.pxRatio;
  /** @type {ChartScale} */
  const at = { x: (value) => left + chart.valToPos(value, "x"), y: (value) => top + chart.valToPos(value, "y") };
  context.save();
  context.scale(uPlot.pxRatio, uPlot.pxRatio);
  if (goal) {
    Object.assign(context, { font: `11px ${font}`, textAlign: "right", textBaseline: "middle", fillStyle: inks.goal });
    context.fillText(goal.text, edges.left - 8, at.y(goal.at) + 2);
  }
  for (const { x, y, low = [], high = [], colour, hasWhiskers, dot = 0 } of lines) {
    for (const k of hasWhiskers ? y.keys() : [...y.keys()].slice(-1)) {
      if (dot) drawDot(context, { x: at.x(x[k]), y: at.y(y[k]) }, dot, colour);
      const [from, to] = [low[k], high[k]];
      if (!hasWhiskers || typeof from !== "number" || typeof to !== "number") continue;
      Object.assign(context, { fillStyle: colour, globalAlpha: 0.45 });
      const upper = at.y(Math.min(most, to));
      context.fillRect(at.x(x[k]) - 1, upper, 2, at.y(Math.max(least, from)) - upper);
      context.globalAlpha = 1;
    }
  }
  over?.(context, at);
  context.restore();
}

/** @param {CanvasRenderingContext2D} context @param {Point} point @param {number} radius @param {string} colour */
export function drawDot(context, { x, y }, radius, colour) {
  context.beginPath();
  context.arc(x, y, radius, 0, 7);
  context.fillStyle = colour;
  context.fill();
}

/** @param {Board[]} boards @returns the right end of the step axis of their curves, in moves: with room while any goes on */
export function stepsEnd(boards) {
  const steps = Math.max(0, ...boards.map(({ progress }) => progress.length - 1));
  return boards.length && boards.every(({ frame }) => frame.outcome) ? Math.max(10, steps) : axisEnd(steps);
}

/** Paint how far boards have come over moves, a curve for each.
 * @param {HTMLElement} place @param {Task} task @param {{board: Board, colour: string, isDashed?: boolean}[]} curves
 * @param {{inks: Inks, font: string, over?: ChartLook["over"]}} look */
export function paintProgress(place, { clock, chart: { goal, axis } }, curves, look) {
  paintChart(place, {
    ...look, goal, edges: { left: 44, right: 14, top: 8, bottom: 22 }, x: movesAxis(stepsEnd(curves.map(({ board }) => board)), clock ? "frames" : "moves"),
    y: axis(place.clientHeight, curves.flatMap(({ board }) => board.progress)),
    lines: curves.map(({ board: { progress: y }, colour, isDashed }) => ({ colour, dash: isDashed ? DASHES : [], dot: 3.5, x: [...y.keys()], y })),
  });
}

/** Paint the legend of a chart, if it is another one: each name after a piece of its line.
 * @param {HTMLElement} place @param {{name: string, colour: string, dash: string}[]} lines */
export function paintLegend(place, lines) {
  const painted = JSON.stringify(lines);
  if (place.dataset.painted === painted) return;
  place.dataset.painted = painted;
  place.replaceChildren(...lines.map(({ name, colour, dash }) => {
    const line = { x1: 0, x2: 22, y1: 4, y2: 4, stroke: colour, "stroke-width": 3, "stroke-dasharray": dash };
    return create("span", [createSvg("svg", { viewBox: "0 0 22 8" }, createSvg("line", line)), name]);
  }));
}
