// @ts-check
// The table of ranks: a row for each explorer, its interval on the common scale, the people's mean as a line through all rows.
import { tickText } from "../common/chart_scale.js";
import { create } from "../common/page.js";
import { intervalText, shown, source } from "./standing.js";

/**
 * @typedef {import("./standing.js").Row} Row
 * @typedef {import("./standing.js").Measure} Measure
 */

/**
 * @param {HTMLTableElement} table
 * @param {HTMLElement} marks where the scale's numbers go
 * @param {Row[]} rows
 * @param {{low: number, high: number, ticks: number[]}} scale
 * @param {Measure} measure
 */
export function paintRanks(table, marks, rows, scale, measure) {
  const share = (/** @type {number} */ value) => `${(100 * (value - scale.low)) / (scale.high - scale.low)}%`;
  marks.replaceChildren(...scale.ticks.map((tick) => {
    const mark = create("i", tickText(tick));
    mark.style.left = share(tick);
    return mark;
  }));
  const hasLikeness = rows.some(({ policy }) => typeof policy?.human_likeness === "number");
  const head = table.tHead?.querySelector("[data-testid=likeness-head]");
  if (head) /** @type {HTMLElement} */ (head).hidden = !hasLikeness;
  const human = rows.find(({ who }) => who === "people")?.figure?.[measure].mean;
  table.tBodies[0].replaceChildren(...rows.map((row) => {
    const head = create("th", [create("i", [], { class: "swatch" }), row.name], { scope: "row" });
    const cells = row.figure ? standing(row, row.figure[measure]) : [missing(row, hasLikeness ? 6 : 5)];
    const line = create("tr", [head, ...cells], { "data-who": row.who, "data-testid": `rank-${row.who === "people" ? "people" : row.name}` });
    line.style.setProperty("--mine", row.colour);
    return line;
  }));

  /**
   * @param {Row} row
   * @param {import("./standing.js").Interval} value
   */
  function standing(row, value) {
    const place = create("div", [], { "aria-hidden": "true" });
    place.append(...scale.ticks.map((tick) => placed("gridline", tick)));
    if (human !== undefined && human >= scale.low && human <= scale.high) place.append(placed("human", human));
    const out = value.mean > scale.high ? "high" : value.mean < scale.low ? "low" : "";
    if (out) {
      const text = out === "high" ? `${shown(value.mean, measure)} \u25b8` : `\u25c2 ${shown(value.mean, measure)}`;
      place.append(create("i", text, { class: `beyond ${out}` }));
    } else {
      if (value.low !== null && value.high !== null) {
        const spread = placed("spread", value.low);
        spread.style.width = `calc(${share(value.high)} - ${share(value.low)})`;
        place.append(spread);
      }
      place.append(placed("dot", value.mean));
    }
    const completed = `${Math.round(100 * (row.figure?.completed ?? 0))} %`;
    const wide = { class: "number wide" };
    return [create("td", place, { class: "scale" }), create("td", shown(value.mean, measure), { class: "number" }),
      create("td", intervalText(value, measure), wide), create("td", completed, wide),
      ...(hasLikeness ? [create("td", likenessText(row.policy?.human_likeness), wide)] : []), create("td", source(row), wide)];
  }
  /**
   * @param {string} name
   * @param {number} value
   */
  function placed(name, value) {
    const mark = create("i", [], { class: name });
    mark.style.left = share(value);
    return mark;
  }
}

/**
 * Return a share of people's moves as text, a dash where it is not known.
 * @param {number | null | undefined} share
 */
function likenessText(share) {
  return typeof share === "number" ? `${Math.round(100 * share)} %` : "\u2013";
}

/**
 * Return the row of a policy without a figure: how far it is.
 * @param {Row} row
 * @param {number} columns
 */
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
