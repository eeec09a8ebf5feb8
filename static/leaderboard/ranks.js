// @ts-check
// The table of ranks: a row for each explorer, its interval on the common scale, the people's mean as a line through all rows.
import { tickText } from "../common/chart_scale.js";
import { create } from "../common/page.js";
import { breakOf, placeOf } from "./scale.js";
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
