// How many people needed how many moves, as columns, with a dot for you and a line for each policy. The lower part paints.
import { createSvg } from "./page.js";

/** Return columns of one width that hold all values: at most `most` of them, whole numbers of moves wide.
 * @param {[number, number][]} counts [moves, how many people]
 * @param {number[]} others further values that must lie on the axis @param {number} [most] @returns {Bin[]} */
export function binsOf(counts, others, most = 16) {
  const values = [...counts.map(([moves]) => moves), ...others];
  if (!values.length) return [];
  const low = Math.floor(Math.min(...values));
  const high = Math.floor(Math.max(...values)) + 1;
  const width = Math.max(1, ...[1, 2, 5, 10, 20, 25, 50, 100, 200, 500, 1000].filter((each) => (high - low) / each > most - 2).map((each) => each * 2));
  const first = Math.floor(low / width) * width;
  const bins = [];
  for (let from = first; from < high; from += width) bins.push({ from, to: from + width, count: 0 });
  for (const [moves, count] of counts) bins[Math.floor((moves - first) / width)].count += count;
  return bins;
}

/** Return the rows in which labels at these places stand without lying over each other, null where there is no room.
 * @param {{at: number, width: number}[]} labels sorted by `at`, their middle @param {number} rows */
export function rowsOf(labels, rows) {
  const ends = Array(rows).fill(-Infinity);
  return labels.map(({ at, width }) => {
    const row = ends.findIndex((end) => at - width / 2 > end + 6);
    if (row < 0) return null;
    ends[row] = at + width / 2;
    return row;
  });
}

/** Return the distribution in one sentence, for who cannot see it.
 * @param {string} target what the moves lead to @param {Bin[]} bins @param {number | null} you @param {Named[]} marks */
export function describe(target, bins, you, marks) {
  const people = bins.filter(({ count }) => count).map(({ from, to, count }) => `${count} from ${from} to ${to - 1}`);
  const policies = marks.map(({ name, moves }) => `${name} ${moves}`);
  return [`Moves to ${target}: ${people.join(", ") || "nobody yet"}`, you === null ? "" : `you ${you}`, ...policies].filter(Boolean).join("; ");
}

const WIDTH = 480;
const BASE = 118;

/** Paint a distribution into an element.
 * @param {HTMLElement} root
 * @param {{target: string, counts: [number, number][], you: number | null, marks?: Named[]}} what you: your own moves; null leaves the
 *   dot out */
export function paintDistribution(root, { target, counts, you, marks = [] }) {
  const bins = binsOf(counts, [...marks.map(({ moves }) => moves), ...(you === null ? [] : [you])]);
  if (!bins.length) return root.replaceChildren();
  const [low, high] = [bins[0].from, bins[bins.length - 1].to];
  const most = Math.max(1, ...bins.map(({ count }) => count));
  const at = (/** @type {number} */ moves) => 14 + ((moves - low) / (high - low)) * (WIDTH - 28);
  const sorted = [...marks].sort((a, b) => a.moves - b.moves);
  const rows = rowsOf(sorted.map(({ name, moves }) => ({ at: at(moves + 0.5), width: 6.4 * name.length + 8 })), 3);
  const depth = Math.max(0, ...rows.map((row) => (row === null ? 0 : row + 1)));
  const svg = createSvg("svg", { class: "distribution", viewBox: `0 0 ${WIDTH} ${BASE + 20 + 15 * depth}`, role: "img", "aria-label": describe(target, bins, you, marks) });
  for (const { from, to, count } of bins) {
    const isYours = you !== null && you >= from && you < to;
    const height = count ? 6 + (70 * count) / most : 0;
    svg.append(createSvg("rect", { class: isYours ? "bar-yours" : "bar-people", x: at(from) + 1.5, y: BASE - height, width: Math.max(2, at(to) - at(from) - 3), height, rx: 2 }));
  }
  sorted.forEach(({ name, moves }, index) => {
    const x = at(moves + 0.5);
    const row = rows[index];
    svg.append(createSvg("line", { class: "policy", x1: x, x2: x, y1: 34, y2: BASE }));
    if (row !== null) svg.append(createSvg("text", { class: "policy-text", x: Math.min(WIDTH - 3.2 * name.length - 4, Math.max(3.2 * name.length + 4, x)), y: BASE + 31 + 15 * row, "text-anchor": "middle" }, name));
  });
  svg.append(createSvg("line", { class: "axis", x1: 8, x2: WIDTH - 8, y1: BASE + 0.5, y2: BASE + 0.5 }));
  svg.append(createSvg("text", { x: 8, y: BASE + 15 }, `${low} moves`), createSvg("text", { x: WIDTH - 8, y: BASE + 15, "text-anchor": "end" }, String(high)));
  if (you !== null) {
    const x = at(you + 0.5);
    svg.append(createSvg("circle", { class: "you", cx: x, cy: 24, r: 7 }));
    svg.append(createSvg("text", { class: "you-text", x: x > WIDTH - 80 ? x - 13 : x + 13, y: 28, "text-anchor": x > WIDTH - 80 ? "end" : "start" }, `you ${Math.round(10 * you) / 10}`));
  }
  root.replaceChildren(svg);
}
