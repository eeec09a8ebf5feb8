// @ts-check
// The leaderboard's charts: coverage over moves, and the learning curve of people with the policies' level.
import { paintChart, paintLegend } from "../common/chart.js";
import { tickText, ticks } from "../common/chart_scale.js";
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
