// How many people needed how many moves, as columns, with a dot for you and a line for each policy. The lower part paints.
import { many } from "./words.js";
import { drawDot, paintChart } from "./chart.js";
import { chartColours } from "./page.js";

/** The fewest columns that an axis has room for: one person's is no slab. */
const FEWEST = 9;

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
  const missing = Math.max(0, FEWEST - Math.ceil((high - first) / width));
  const before = Math.min(Math.floor(missing / 2), Math.floor(first / width));
  for (let from = first - width * before; from < high + width * (missing - before); from += width) bins.push({ from, to: from + width, count: 0 });
  for (const [moves, count] of counts) bins[Math.floor((moves - bins[0].from) / width)].count += count;
  return bins;
}

/** @param {Bin[]} bins @returns the edges of columns that the axis names: some four of them, the first among them */
export function edgesOf(bins) {
  const stride = Math.ceil(bins.length / 4);
  return [...bins.map(({ from }) => from), bins[bins.length - 1].to].filter((_, index) => index % stride === 0);
}

/** @param {number} most people in a column @returns {number[]} the numbers of people that have a line */
export const peopleLines = (most) => (most % 2 ? [most] : [most / 2, most]);

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

const ROW = 15;
/** @type {WeakMap<Element, () => ChartLook>} */
const looks = new WeakMap();
/** @type {ResizeObserver | undefined} */
let sizes;

/** @param {Element} place */
function draw(place) {
  const look = looks.get(place);
  if (look) paintChart(/** @type {HTMLElement} */ (place), look());
}

function listen() {
  addEventListener("theme", () => document.querySelectorAll(".distribution").forEach(draw));
  return new ResizeObserver((entries) => entries.forEach(({ target }) => draw(target)));
}

/** Paint a distribution into an element as soon as it has a size, and whenever it has another one.
 * @param {HTMLElement} place
 * @param {{target: string, counts: [number, number][], you: number | null, marks?: Named[]}} what you: your own moves; null leaves the
 *   dot out */
export function paintDistribution(place, { target, counts, you, marks = [] }) {
  const bins = binsOf(counts, [...marks.map(({ moves }) => moves), ...(you === null ? [] : [you])]);
  place.classList.toggle("distribution", bins.length > 0);
  if (!bins.length) return;
  place.setAttribute("role", "img");
  place.setAttribute("aria-label", describe(target, bins, you, marks));
  const [low, high] = [bins[0].from, bins[bins.length - 1].to];
  const sorted = [...marks].sort((a, b) => a.moves - b.moves);
  const isYours = (/** @type {Bin} */ { from, to }) => you !== null && you >= from && you < to;
  const columns = (/** @type {string} */ colour, /** @type {(bin: Bin) => boolean} */ takes) => ({
    colour, dash: [], isColumns: true, x: bins.map(({ from, to }) => (from + to) / 2), y: bins.map((bin) => (takes(bin) ? bin.count : NaN)),
  });
  const most = Math.max(1, ...bins.map(({ count }) => count));
  looks.set(place, () => {
    const colours = chartColours(place);
    return {
      ...colours, edges: { left: 32, right: 32, top: 40, bottom: 24 + (marks.length ? 3 * ROW : 0) },
      x: { low, high, ticks: edgesOf(bins), text: (moves) => (moves === low ? many(moves, "move") : String(moves)) },
      y: { low: 0, high: most, ticks: peopleLines(most), text: String },
      lines: [columns(colours.inks.base, (bin) => !isYours(bin)), columns(colours.you, isYours)],
      over: (context, at) => {
        context.textAlign = "center";
        const widths = sorted.map(({ name, moves }) => ({ at: at.x(moves + 0.5), width: context.measureText(name).width }));
        const rows = rowsOf(widths, 3);
        Object.assign(context, { fillStyle: colours.policy, strokeStyle: colours.policy, lineWidth: 2 });
        sorted.forEach(({ name }, index) => {
          const [{ at: x, width }, row] = [widths[index], rows[index]];
          context.setLineDash([4, 3]);
          context.stroke(new Path2D(`M${x} ${at.y(0)}V34`));
          const inside = Math.min(place.clientWidth - width / 2, Math.max(width / 2, x));
          if (row !== null) context.fillText(name, inside, at.y(0) + 30 + ROW * row);
        });
        if (you === null) return;
        const x = at.x(you + 0.5);
        const isLeft = x > place.clientWidth - 80;
        drawDot(context, { x, y: 20 }, 7, colours.you);
        Object.assign(context, { fillStyle: colours.you, textAlign: isLeft ? "end" : "start" });
        context.fillText(`you ${Math.round(10 * you) / 10}`, isLeft ? x - 13 : x + 13, 24);
      },
    };
  });
  (sizes ??= listen()).observe(place);
}
