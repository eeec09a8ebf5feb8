// @ts-check
// The table of ranks: a row an explorer, its interval on the common scale, the human level as a line through all of them.
import { intervalText, shown, source, tickText } from "./standing.js";

/**
 * @typedef {import("./standing.js").Row} Row
 * @typedef {import("./standing.js").Measure} Measure
 */

/**
 * @param {string} kind
 * @param {string} name
 * @param {string} [text]
 */
function made(kind, name, text) {
  const element = document.createElement(kind);
  element.className = name;
  if (text !== undefined) element.textContent = text;
  return element;
}

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
    const mark = made("i", "", tickText(tick));
    mark.style.left = share(tick);
    return mark;
  }));
  const human = rows.find(({ who }) => who === "people")?.figure?.[measure].mean;
  table.tBodies[0].replaceChildren(...rows.map((row) => {
    const line = document.createElement("tr");
    line.dataset.who = row.who;
    line.dataset.testid = `rank-${row.who === "people" ? "people" : row.name}`;
    line.style.setProperty("--mine", row.colour);
    const head = made("th", "");
    head.setAttribute("scope", "row");
    head.append(made("i", "swatch"), row.name);
    line.append(head, ...(row.figure ? standing(row, row.figure[measure]) : [missing(row)]));
    return line;
  }));

  /**
   * @param {Row} row
   * @param {import("./standing.js").Interval} value
   */
  function standing(row, value) {
    const cell = made("td", "scale");
    const place = document.createElement("div");
    place.setAttribute("aria-hidden", "true");
    place.append(...scale.ticks.map((tick) => placed("gridline", tick)));
    if (human !== undefined && human >= scale.low && human <= scale.high) place.append(placed("human", human));
    const out = value.mean > scale.high ? "high" : value.mean < scale.low ? "low" : "";
    if (out) place.append(made("i", `beyond ${out}`, out === "high" ? `${shown(value.mean, measure)} \u25b8` : `\u25c2 ${shown(value.mean, measure)}`));
    else {
      if (value.low !== null && value.high !== null) {
        const spread = placed("spread", value.low);
        spread.style.width = `calc(${share(value.high)} - ${share(value.low)})`;
        place.append(spread);
      }
      place.append(placed("dot", value.mean));
    }
    cell.append(place);
    const completed = `${Math.round(100 * (row.figure?.completed ?? 0))} %`;
    return [cell, made("td", "number", shown(value.mean, measure)), made("td", "number wide", intervalText(value, measure)),
      made("td", "number wide", completed), made("td", "number wide", source(row))];
  }
  /**
   * @param {string} name
   * @param {number} value
   */
  function placed(name, value) {
    const mark = made("i", name);
    mark.style.left = share(value);
    return mark;
  }
}

/**
 * The row of a policy without a figure: how far it is.
 * @param {Row} row
 */
function missing({ policy }) {
  const cell = document.createElement("td");
  cell.colSpan = 5;
  const line = made("div", "idle");
  if (policy?.state === "failed") line.append(`No figure: ${policy.error}`);
  else if (policy?.state === "computing") {
    const bar = Object.assign(document.createElement("progress"), { max: policy.of, value: policy.done });
    bar.setAttribute("aria-label", `Evaluation of ${policy.name}`);
    line.append(bar, `terrain ${Math.min(policy.done + 1, policy.of)} of ${policy.of}`);
  } else line.append("waiting to be evaluated");
  cell.append(line);
  return cell;
}
