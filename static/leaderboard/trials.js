// @ts-check
// The learning curve: people's first, second, ... episode, with the policies' level.
import { paintLegend } from "../common/chart.js";
import { tickText, ticks } from "../common/chart_scale.js";
import { paintLines } from "./line_chart.js";
import { shown } from "./standing.js";

const people = (/** @type {number} */ count) => (count === 1 ? "1 player" : `${count} players`);

/** @param {Leaderboard.Trial[]} trials @returns what the points rest on */
export function footing(trials) {
  const [first, last] = [trials[0], trials[trials.length - 1]];
  const few = last.players < first.players ? ": the later points rest on fewer people" : "";
  return `${people(first.players)} in the first episode, ${people(last.players)} in episode ${last.trial}${few}. Bars are 95 % intervals; a single player has none. Policies do not learn here.`;
}

/** @param {{canvas: HTMLCanvasElement, legend: HTMLElement, note: HTMLElement}} place
 * @param {Leaderboard.Trial[]} trials @param {Leaderboard.Row[]} rows @param {Leaderboard.Measure} measure */
export function paintTrials({ canvas, legend, note }, trials, rows, measure) {
  const who = rows.find((row) => row.who === "people");
  if (!who || trials.length === 0) return;
  const end = Math.max(2, trials.length);
  const values = trials.map((trial) => trial[measure]);
  const flat = rows.flatMap((row) => (row.figure && row.who === "policy" && row.name !== "random" ? [{ ...row, mean: row.figure[measure].mean }] : []));
  const level = flat.map(({ name, colour, dash, mean }) => ({ name, colour, dash, x: [0.7, end + 0.3], y: [mean, mean], low: [], high: [] }));
  const own = { name: who.name, colour: who.colour, dash: "", hasDots: true, x: trials.map(({ trial }) => trial), y: values.map(({ mean }) => mean),
    low: values.map(({ low }) => low), high: values.map(({ high }) => high) };
  const means = [...own.y, ...flat.map(({ mean }) => mean)];
  const room = (Math.max(...means) - Math.min(...means)) * 0.25 || 1;
  const [least, most] = [Math.min(...means) - room, Math.max(...means) + room];
  paintLegend(legend, [own, ...flat]);
  paintLines(canvas, [...level, own], {
    x: { low: 0.7, high: end + 0.3, ticks: ticks(0, end).filter(Number.isInteger).map((tick) => tick || 1), text: String, title: "episode of a player" },
    y: { low: least, high: most, ticks: ticks(least, most), text: tickText, title: "" },
    label: trials.map((trial) => `Episode ${trial.trial}: ${shown(trial[measure].mean, measure)}, ${people(trial.players)}`).join("; "),
  });
  note.textContent = footing(trials);
}
