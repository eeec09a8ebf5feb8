// The leaderboard's charts: coverage over moves, and the learning curve of people with the policies' level.
import { paintChart, paintLegend } from "../common/chart.js";
import { ticks, tickText } from "../common/chart_scale.js";
import { chartColours } from "../common/colours.js";
import { coverageEnd, curveText, shown } from "./standing.js";

const EDGES = { left: 44, right: 12, top: 10, bottom: 40 };
const dashes = (/** @type {string} */ dash) => (dash ? dash.split(" ").map(Number) : []);

/** @param {Leaderboard.ChartPlace} place @param {Task} task @param {Leaderboard.Row[]} rows */
export function paintCoverage({ chart, legend, note }, { chart: { goal, axis }, target }, rows) {
  const drawn = rows.flatMap((row) => (row.figure?.curve ? [{ ...row, curve: row.figure.curve }] : []));
  const end = coverageEnd(drawn.map(({ curve }) => curve));
  const lines = drawn.map(({ colour, dash, curve: { steps, mean, low, high } }) =>
    ({ colour, dash: dashes(dash), x: steps, y: mean, low, high }));
  paintLegend(legend, drawn);
  paintChart(chart, {
    ...chartColours(chart), lines: lines.reverse(), edges: EDGES, title: "moves", goal,
    x: { low: 0, high: end, ticks: ticks(0, end), text: tickText },
    y: axis(chart.clientHeight, []),
  });
  const label = drawn.map(({ name, curve }) => curveText(name, curve)).join(". ");
  chart.setAttribute("aria-label", label || "No figures yet");
  const band = drawn.some(({ curve }) => curve.low.length) ? ", with the 95 % interval of the mean" : "";
  const text = `Mean share of the terrain on the map${band}. An episode that has ended keeps what it had. `
    + `The dotted line is ${target}.`;
  note.textContent = drawn.length ? text : "";
}

const people = (/** @type {number} */ count) => (count === 1 ? "1 player" : `${count} players`);

/** @param {Leaderboard.Trial[]} trials @returns what the points rest on */
export function footing(trials) {
  const [first, last] = [trials[0], trials[trials.length - 1]];
  const few = last.players < first.players ? ": the later points rest on fewer people" : "";
  return `${people(first.players)} in the first episode, ${people(last.players)} in episode ${last.trial}${few}. `
    + "Bars are 95 % intervals; a single player has none. Policies do not learn here.";
}

/** @param {Leaderboard.ChartPlace} place @param {Leaderboard.Trial[]} trials @param {Leaderboard.Row[]} rows
 * @param {Leaderboard.Measure} measure */
export function paintTrials({ chart, legend, note }, trials, rows, measure) {
  const who = rows.find((row) => row.who === "people");
  if (!who || trials.length === 0) return;
  const end = Math.max(2, trials.length);
  const [left, right] = [0.7, end + 0.3];
  const values = trials.map((trial) => trial[measure]);
  const flat = rows.flatMap((row) =>
    (row.figure && row.who === "policy" && row.name !== "random" ? [{ ...row, mean: row.figure[measure].mean }] : []));
  /** @type {ChartLine[]} */
  const level = flat.map(({ colour, dash, mean }) =>
    ({ colour, dash: dashes(dash), x: [left, right], y: [mean, mean] }));
  const own = { colour: who.colour, dash: [], hasWhiskers: true, dot: 3.2, x: trials.map(({ trial }) => trial),
    y: values.map(({ mean }) => mean), low: values.map(({ low }) => low), high: values.map(({ high }) => high) };
  const means = [...own.y, ...flat.map(({ mean }) => mean)];
  const room = (Math.max(...means) - Math.min(...means)) * 0.25 || 1;
  const [least, most] = [Math.min(...means) - room, Math.max(...means) + room];
  paintLegend(legend, [{ ...who, dash: "" }, ...flat]);
  const whole = ticks(0, end).filter(Number.isInteger).map((tick) => tick || 1);
  paintChart(chart, {
    ...chartColours(chart), lines: [...level, own], edges: EDGES, title: "episode of a player",
    x: { low: left, high: right, ticks: [...new Set(whole)], text: String },
    y: { low: least, high: most, ticks: ticks(least, most), text: tickText },
  });
  const label = trials.map((trial) =>
    `Episode ${trial.trial}: ${shown(trial[measure].mean, measure)}, ${people(trial.players)}`);
  chart.setAttribute("aria-label", label.join("; "));
  note.textContent = footing(trials);
}

const STOPS = [[14, 11, 13], [74, 36, 24], [160, 84, 44], [255, 179, 71], [255, 246, 226]];

/** Return the colour of a share 0..1 as [r, g, b]: night, soil, accent, light; lightness rises all the way.
 * @param {number} share */
export function heat(share) {
  const at = Math.min(1, Math.max(0, share)) * (STOPS.length - 1);
  const k = Math.min(STOPS.length - 2, Math.floor(at));
  return STOPS[k].map((low, channel) => Math.round(low + (STOPS[k + 1][channel] - low) * (at - k)));
}

/** Return the common top of the scale: what one cell in a hundred exceeds in the busiest map, random walks left out.
 * @param {{name: string, visits: number[][]}[]} maps */
export function topOf(maps) {
  const steady = maps.filter(({ name }) => name !== "random");
  const tops = (steady.length ? steady : maps).map(({ visits }) => {
    const cells = visits.flat().sort((a, b) => a - b);
    return cells[Math.floor(cells.length * 0.99)] ?? 1;
  });
  return Math.max(0.5, ...tops);
}

/** The gradient of the key, for CSS. */
export const GRADIENT = `linear-gradient(90deg, ${STOPS.map((stop) => `rgb(${stop.join(" ")})`).join(", ")})`;

/** @param {HTMLElement} place @param {{name: string, colour: string, visits: number[][]}[]} maps */
export function paintMaps(place, maps) {
  const top = topOf(maps);
  place.replaceChildren(...maps.map(({ name, colour, visits }) => {
    const figure = document.createElement("figure");
    const caption = document.createElement("figcaption");
    const swatch = Object.assign(document.createElement("i"), { className: "swatch" });
    swatch.style.setProperty("--mine", colour);
    caption.append(swatch, name);
    figure.append(painted(name, visits, top), caption);
    return figure;
  }));
}

/** @param {string} name @param {number[][]} visits @param {number} top */
function painted(name, visits, top) {
  const canvas = document.createElement("canvas");
  canvas.width = visits[0].length;
  canvas.height = visits.length;
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", `Visits of ${name}: ${inWords(visits)}`);
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d", { alpha: false }));
  const image = context.createImageData(canvas.width, canvas.height);
  visits.flat().forEach((value, k) => image.data.set([...heat(Math.sqrt(value / top)), 255], 4 * k));
  context.putImageData(image, 0, 0);
  return canvas;
}

/** @param {number[][]} visits @returns how visits divide over the quarters of the grid */
export function inWords(visits) {
  const [rows, cols] = [visits.length, visits[0].length];
  const sums = { "north-west": 0, "north-east": 0, "south-west": 0, "south-east": 0 };
  visits.forEach((line, row) => line.forEach((value, col) => {
    sums[/** @type {keyof typeof sums} */ (`${row < rows / 2 ? "north" : "south"}-${col < cols / 2 ? "west" : "east"}`)] += value;
  }));
  const all = Object.values(sums).reduce((a, b) => a + b, 0) || 1;
  return Object.entries(sums).map(([where, sum]) => `${Math.round((100 * sum) / all)} percent in the ${where}`).join(", ");
}
