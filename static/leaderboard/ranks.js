// The table of ranks: a row for each explorer, its interval on the common scale, the people's mean as a line through all rows.
import { paintChart, paintLegend } from "../common/chart.js";
import { span, ticks, tickText } from "../common/chart_scale.js";
import { chartColours, create } from "../common/page.js";
import { many } from "../common/words.js";
import { coverageEnd, curveText, intervalText, missingText, shown, source } from "./standing.js";

/** @param {HTMLTableElement} table @param {HTMLElement} marks where the scale's numbers go
 * @param {Task} task @param {Leaderboard.Row[]} rows @param {Leaderboard.Scale} scale @param {Leaderboard.Measure} measure */
export function paintRanks(table, marks, task, rows, scale, measure) {
  const percent = (/** @type {number} */ share) => `${100 * share}%`;
  const left = (/** @type {number} */ value) => `left: ${percent(placeOf(scale, value) ?? 0)}`;
  const gap = breakOf(scale);
  marks.replaceChildren(...[...scale.ticks, ...scale.farTicks].map((tick) =>
    create("i", tickText(tick), { class: scale.farTicks.includes(tick) ? "far" : "", style: left(tick) })));
  const human = rows.find(({ who }) => who === "people")?.figure?.[measure].mean;
  table.tBodies[0].replaceChildren(...rows.map((row) => {
    const summary = row.policy?.summary ? [create("small", row.policy.summary, { class: "wide", title: row.policy.summary })] : [];
    const head = create("th", [create("i", [], { class: "swatch" }), task.nameOf(row.name), ...summary], { scope: "row" });
    const cells = row.figure ? standing(row, row.figure[measure]) : [missing(task, row, 5)];
    return create("tr", [head, ...cells],
      { "data-who": row.who, "data-testid": `rank-${row.policy?.name ?? row.who}`, style: `--mine: ${row.colour}` });
  }));

  /** @param {Leaderboard.Row} row @param {Answers.Interval} value */
  function standing(row, value) {
    const place = create("div", scale.ticks.map((tick) => mark("gridline", left(tick))), { "aria-hidden": "true" });
    if (gap) place.append(mark("break", `left: ${percent(gap.from)}; width: ${percent(gap.to - gap.from)}`));
    if (human !== undefined) place.append(mark("human", left(human)));
    if (value.low !== null && value.high !== null) {
      const width = percent((placeOf(scale, value.high) ?? 1) - (placeOf(scale, value.low) ?? 0));
      place.append(mark("spread", `${left(value.low)}; width: ${width}`));
    }
    place.append(mark("dot", left(value.mean)));
    const completed = `${Math.round(100 * (row.figure?.completed ?? 0))} %`;
    const wide = { class: "number wide" };
    return [create("td", place, { class: "scale" }), create("td", shown(value.mean, measure), { class: "number" }),
      create("td", intervalText(value, measure), wide), create("td", completed, wide),
      create("td", source(task, row), wide)];
  }
}

/** @param {string} name @param {string} style where it stands */
const mark = (name, style) => create("i", [], { class: name, style });

/** @param {Answers.LeaderboardEntry} board @returns the row of people without a mean: it invites */
export function invitation(board) {
  const { study } = board;
  const text = missingText(board);
  const head = create("th", [create("i", [], { class: "swatch" }), study ? "People" : "Volunteers"], { scope: "row" });
  const line = study
    ? create("span", "Nobody finished this study.")
    : create("span", [`${text[0].toUpperCase()}${text.slice(1)} `, create("a", board.players ? "Play ranked" : "Be the first", { href: "./", "data-testid": "be-the-first" })]);
  const cell = create("td", create("div", line, { class: "idle" }), { colspan: "5" });
  return create("tr", [head, cell], { "data-who": "nobody", "data-testid": "rank-nobody" });
}

/** @param {Task} task @param {Leaderboard.Row} row @param {number} columns
 * @returns the row of a policy without a figure: how far it is */
function missing(task, { policy }, columns) {
  const line = create("div", [], { class: "idle" });
  if (policy?.state === "failed") line.append(`No figure: ${policy.error}`);
  else if (policy?.state === "computing") {
    const bar = create("progress", [], { max: String(policy.of), value: String(policy.done), "aria-label": `Evaluation of ${task.nameOf(policy.name)}` });
    line.append(bar, `${task.round} ${Math.min(policy.done + 1, policy.of)} of ${policy.of}`);
  } else line.append(policy?.state === "missing" ? "not evaluated here yet" : "waiting to be evaluated");
  return create("td", line, { colspan: String(columns) });
}

/** Shares of the width that the far piece and the break before it take. */
const FAR = 0.1;
const BREAK = 0.05;

/** Return the scale for some figures: round numbers around everybody near the best, the others apart.
 * @param {Leaderboard.Figure[]} figures @param {Leaderboard.Measure} measure @returns {Leaderboard.Scale} */
export function scaleOf(figures, measure) {
  const isSteps = measure === "steps";
  const means = figures.map((figure) => figure[measure].mean).sort((a, b) => a - b);
  if (means.length === 0) return { near: { low: 0, high: 1, from: 0, to: 1 }, far: null, ticks: [], farTicks: [] };
  const best = isSteps ? means[0] : means[means.length - 1];
  const isNear = (/** @type {Leaderboard.Figure} */ figure) => (isSteps ? figure.steps.mean <= 2.5 * best : figure.score.mean >= best - 0.3);
  const [low, high] = rangeOf(figures.filter(isNear), measure);
  const others = figures.filter((figure) => !isNear(figure));
  if (others.length === 0) return { near: { low, high, from: 0, to: 1 }, far: null, ticks: ticks(low, high), farTicks: [] };
  const [least, most] = rangeOf(others, measure);
  const [near, far] = isSteps ? [{ from: 0, to: 1 - FAR - BREAK }, { from: 1 - FAR, to: 1 }] : [{ from: FAR + BREAK, to: 1 }, { from: 0, to: FAR }];
  return { near: { low, high, ...near }, far: { low: least, high: most, ...far }, ticks: ticks(low, high), farTicks: farTicks(others.map((figure) => figure[measure].mean), isSteps) };
}

/** Return the range of some figures with their intervals, and a little room.
 * @param {Leaderboard.Figure[]} figures @param {Leaderboard.Measure} measure @returns {[number, number]} */
function rangeOf(figures, measure) {
  const values = figures.map((figure) => figure[measure]);
  const least = Math.min(...values.map(({ low, mean }) => low ?? mean));
  const most = Math.max(...values.map(({ high, mean }) => high ?? mean));
  const room = Math.max((most - least) * 0.08, measure === "steps" ? 2 : 0.005);
  return [least - room, most + room];
}

/** Return the numbers under the far piece: one, or the least and the most where they stand apart.
 * @param {number[]} means @param {boolean} isSteps */
function farTicks(means, isSteps) {
  const round = (/** @type {number} */ mean) => (isSteps ? Math.round(mean) : Number(mean.toFixed(2)));
  const [least, most] = [Math.min(...means), Math.max(...means)].map(round);
  return most - least > 0.1 * Math.abs(most) ? [least, most] : [round(means.reduce((sum, mean) => sum + mean, 0) / means.length)];
}

/** Return where a value stands, as a share 0..1 of the width; null where it is on neither piece.
 * @param {Leaderboard.Scale} scale @param {number} value */
export function placeOf({ near, far }, value) {
  const piece = [near, far].find((each) => each && value >= each.low && value <= each.high);
  return piece ? piece.from + ((value - piece.low) / (piece.high - piece.low)) * (piece.to - piece.from) : null;
}

/** Return the strip in which the axis is broken, as shares of the width; null where it is whole.
 * @param {Leaderboard.Scale} scale */
export const breakOf = ({ near, far }) => far && { from: Math.min(near.to, far.to), to: Math.max(near.from, far.from) };

/** @param {Task} task @returns what gives a row the name that pages say */
const titled = (task) => (/** @type {Leaderboard.Row} */ row) => ({ ...row, name: task.nameOf(row.name) });
const EDGES = { left: 44, right: 12, top: 10, bottom: 40 };
const dashes = (/** @type {string} */ dash) => (dash ? dash.split(" ").map(Number) : []);

/** @param {Leaderboard.ChartPlace} place @param {Task} task @param {Leaderboard.Row[]} rows */
export function paintCoverage({ chart, legend, note }, task, rows) {
  const { chart: { goal, axis }, target, round } = task;
  const drawn = rows.flatMap((row) => (row.figure?.curve ? [{ ...row, curve: row.figure.curve }] : []));
  const end = coverageEnd(drawn.map(({ curve }) => curve));
  const lines = drawn.map(({ colour, dash, curve: { steps, mean, low, high } }) =>
    ({ colour, dash: dashes(dash), x: steps, y: mean, low, high }));
  paintLegend(legend, drawn.map(titled(task)));
  paintChart(chart, {
    ...chartColours(chart), lines: lines.reverse(), edges: EDGES, title: "moves", goal,
    x: { low: 0, high: end, ticks: ticks(0, end), text: tickText },
    y: axis(chart.clientHeight, []),
  });
  const label = drawn.map(({ name, curve }) => curveText(task.nameOf(name), curve)).join(". ");
  chart.setAttribute("aria-label", label || "No figures yet");
  const band = drawn.some(({ curve }) => curve.low.length) ? ", with the 95 % interval of the mean" : "";
  const text = `Mean share of the ${round} on the map${band}. An episode that has ended keeps what it had. `
    + `The dotted line is ${target}.`;
  note.textContent = drawn.length ? text : "";
}

/** @param {Answers.TrialFigure[]} trials @returns what the points rest on */
export function footing(trials) {
  const [first, last] = [trials[0], trials[trials.length - 1]];
  const few = last.players < first.players ? ": the later points rest on fewer people" : "";
  return `${many(first.players, "player")} in the first episode, ${many(last.players, "player")} in episode ${last.trial}${few}. `
    + "Bars are 95 % intervals; a single player has none. Policies do not learn here.";
}

/** @param {Leaderboard.ChartPlace} place @param {Task} task @param {Answers.TrialFigure[]} trials
 * @param {Leaderboard.Row[]} rows @param {Leaderboard.Measure} measure */
export function paintTrials({ chart, legend, note }, task, trials, rows, measure) {
  const who = rows.find((row) => row.who === "people");
  if (!who || trials.length === 0) return;
  const end = Math.max(2, trials.length);
  const [left, right] = [0.7, end + 0.3];
  const values = trials.map((trial) => trial[measure]);
  const flat = rows.flatMap((row) =>
    (row.figure && row.who === "policy" && row.policy?.name !== "random" ? [{ ...row, mean: row.figure[measure].mean }] : []));
  /** @type {ChartLine[]} */
  const level = flat.map(({ colour, dash, mean }) =>
    ({ colour, dash: dashes(dash), x: [left, right], y: [mean, mean] }));
  const own = { colour: who.colour, dash: [], hasWhiskers: true, dot: 3.2, x: trials.map(({ trial }) => trial),
    y: values.map(({ mean }) => mean), low: values.map(({ low }) => low), high: values.map(({ high }) => high) };
  const [low, high] = span([...own.y, ...own.low, ...own.high, ...flat.map(({ mean }) => mean)]) ?? [0, 1]; // every interval whole
  const room = (high - low) * 0.06;
  const [least, most] = [low - room, high + room];
  paintLegend(legend, [{ ...who, dash: "" }, ...flat].map(titled(task)));
  const whole = ticks(0, end).filter(Number.isInteger).map((tick) => tick || 1);
  paintChart(chart, {
    ...chartColours(chart), lines: [...level, own], edges: EDGES, title: "episode of a player",
    x: { low: left, high: right, ticks: [...new Set(whole)], text: String },
    y: { low: least, high: most, ticks: ticks(least, most), text: tickText },
  });
  const label = trials.map((trial) =>
    `Episode ${trial.trial}: ${shown(trial[measure].mean, measure)}, ${many(trial.players, "player")}`);
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

/** @param {HTMLElement} place @param {Task} task @param {{name: string, colour: string, visits: number[][]}[]} maps */
export function paintMaps(place, task, maps) {
  const top = topOf(maps);
  place.replaceChildren(...maps.map(({ name, colour, visits }) =>
    create("figure", [painted(task.nameOf(name), visits, top), create("figcaption", [mark("swatch", `--mine: ${colour}`), task.nameOf(name)])])));
}

/** @param {string} name @param {number[][]} visits @param {number} top */
function painted(name, visits, top) {
  const canvas = create("canvas", [], { role: "img", "aria-label": `Visits of ${name}: ${inWords(visits)}`,
    width: String(visits[0].length), height: String(visits.length) });
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
