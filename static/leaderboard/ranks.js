// The table of ranks: a row for each explorer, its interval on the common scale, the people's mean as a line through all rows.
import { ticks, tickText } from "../common/chart_scale.js";
import { create } from "../common/page.js";
import { intervalText, shown, source } from "./standing.js";

/** @param {HTMLTableElement} table @param {HTMLElement} marks where the scale's numbers go
 * @param {Leaderboard.Row[]} rows @param {Leaderboard.Scale} scale @param {Leaderboard.Measure} measure */
export function paintRanks(table, marks, rows, scale, measure) {
  const percent = (/** @type {number} */ share) => `${100 * share}%`;
  const gap = breakOf(scale);
  marks.replaceChildren(...[...scale.ticks, ...scale.farTicks].map((tick) => {
    const mark = create("i", tickText(tick), { class: scale.farTicks.includes(tick) ? "far" : "" });
    mark.style.left = percent(placeOf(scale, tick) ?? 0);
    return mark;
  }));
  const hasLikeness = rows.some(({ policy }) => typeof policy?.human_likeness === "number");
  const head = table.tHead?.querySelector("[data-testid=likeness-head]");
  if (head) /** @type {HTMLElement} */ (head).hidden = !hasLikeness;
  const human = rows.find(({ who }) => who === "people")?.figure?.[measure].mean;
  table.tBodies[0].replaceChildren(...rows.map((row) => {
    const summary = row.policy?.summary ? [create("small", row.policy.summary, { class: "wide", title: row.policy.summary })] : [];
    const head = create("th", [create("i", [], { class: "swatch" }), row.name, ...summary], { scope: "row" });
    const cells = row.figure ? standing(row, row.figure[measure]) : [missing(row, hasLikeness ? 6 : 5)];
    const line = create("tr", [head, ...cells], { "data-who": row.who, "data-testid": `rank-${row.who === "people" ? "people" : row.name}` });
    line.style.setProperty("--mine", row.colour);
    return line;
  }));

  /** @param {Leaderboard.Row} row @param {Interval} value */
  function standing(row, value) {
    const place = create("div", [], { "aria-hidden": "true" });
    place.append(...scale.ticks.map((tick) => placed("gridline", tick)));
    if (gap) {
      const strip = create("i", [], { class: "break" });
      Object.assign(strip.style, { left: percent(gap.from), width: percent(gap.to - gap.from) });
      place.append(strip);
    }
    if (human !== undefined) place.append(placed("human", human));
    if (value.low !== null && value.high !== null) {
      const spread = placed("spread", value.low);
      spread.style.width = percent((placeOf(scale, value.high) ?? 1) - (placeOf(scale, value.low) ?? 0));
      place.append(spread);
    }
    place.append(placed("dot", value.mean));
    const completed = `${Math.round(100 * (row.figure?.completed ?? 0))} %`;
    const wide = { class: "number wide" };
    return [create("td", place, { class: "scale" }), create("td", shown(value.mean, measure), { class: "number" }),
      create("td", intervalText(value, measure), wide), create("td", completed, wide),
      ...(hasLikeness ? [create("td", likenessText(row.policy?.human_likeness), wide)] : []), create("td", source(row), wide)];
  }
  /** @param {string} name @param {number} value */
  function placed(name, value) {
    const mark = create("i", [], { class: name });
    mark.style.left = percent(placeOf(scale, value) ?? 0);
    return mark;
  }
}

/** @param {Leaderboard.BoardListing} board @returns the row of people where nobody has played: it invites */
export function invitation({ study }) {
  const head = create("th", [create("i", [], { class: "swatch" }), study ? "People" : "Volunteers"], { scope: "row" });
  const line = study
    ? create("span", "Nobody finished this study.")
    : create("span", ["Nobody has played this ranked yet. ", create("a", "Be the first", { href: "./", "data-testid": "be-the-first" })]);
  const cell = create("td", create("div", line, { class: "idle" }), { colspan: "6" });
  const row = create("tr", [head, cell], { "data-who": "nobody", "data-testid": "rank-nobody" });
  return row;
}

/** @param {number | null | undefined} share @returns a share of people's moves as text, a dash where it is not known */
function likenessText(share) {
  return typeof share === "number" ? `${Math.round(100 * share)} %` : "\u2013";
}

/** @param {Leaderboard.Row} row @param {number} columns @returns the row of a policy without a figure: how far it is */
function missing({ policy }, columns) {
  const cell = document.createElement("td");
  cell.colSpan = columns;
  const line = create("div", [], { class: "idle" });
  if (policy?.state === "failed") line.append(`No figure: ${policy.error}`);
  else if (policy?.state === "computing") {
    const bar = create("progress", [], { max: String(policy.of), value: String(policy.done), "aria-label": `Evaluation of ${policy.name}` });
    line.append(bar, `terrain ${Math.min(policy.done + 1, policy.of)} of ${policy.of}`);
  } else line.append("waiting to be evaluated");
  cell.append(line);
  return cell;
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
export function breakOf({ near, far }) {
  return far && { from: Math.min(near.to, far.to), to: Math.max(near.from, far.from) };
}
