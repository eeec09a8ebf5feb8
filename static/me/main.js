// A player's own page: bests, place among people, every episode. The only module of this page that knows all the others.
import { request } from "../common/api.js";
import { paintDistribution } from "../common/distribution.js";
import { paintChart } from "../common/chart.js";
import { ticks, tickText } from "../common/chart_scale.js";
import { all, by, chartColours, create, put } from "../common/page.js";
import { loadTask, showTask } from "../common/task.js";
import { percent, score } from "../common/words.js";
import { bestText, gapsText, kindText, standingText, summary } from "./words.js";

/** @type {Task} */
let task;
const PAGE = 50;
let shown = 0;
let last = "";

const expert = () => task.nameOf(task.expert ?? "");

/** @param {number} at_ms */
const timeText = (at_ms) => new Date(at_ms).toLocaleString(undefined, { day: "numeric", month: "short", hour: "2-digit", minute: "2-digit" });

/** @param {Answers.Best} figure @returns the panel of one configuration */
function bestPanel(figure) {
  const { best, people } = figure;
  const number = best ? [create("a", String(best.moves), { href: `watch/${encodeURIComponent(best.episode)}`, "data-testid": "best" })] : [];
  const plot = create("div");
  /** @type {Map<number, number>} */
  const counts = new Map();
  for (const mean of people.means) counts.set(Math.round(mean), (counts.get(Math.round(mean)) ?? 0) + 1);
  if (people.means.length > 1) paintDistribution(plot, { target: task.target, counts: [...counts], you: people.you });
  return create("section", [
    create("h2", figure.place),
    create("p", [...number, create("small", best ? " moves, your best" : "No best yet")], { class: "best" }),
    create("p", bestText(task, figure), { class: "fine" }),
    plot,
    create("p", standingText(task, figure), { class: "fine" }),
  ], { class: "panel" });
}

/** @param {Answers.OwnEpisode} episode @returns the row of one episode */
function episodeRow(episode) {
  const { outcome, moves, coverage } = episode;
  const [kind, reason] = kindText(task, episode);
  const when = create("a", timeText(episode.ended_ms), { href: `watch/${encodeURIComponent(episode.episode)}` });
  const kindCell = create("td", kind);
  kindCell.title = reason;
  return create("tr", [
    create("th", when, { scope: "row" }), create("td", episode.place), kindCell,
    create("td", outcome === "abandoned" ? "left" : task.outcome(outcome), { class: task.successes.includes(outcome) ? "good" : outcome === "abandoned" ? "left" : "bad" }),
    create("td", String(moves), { class: "number" }), ...(task.shareText ? [create("td", coverage === null ? "" : `${percent(coverage)} %`, { class: "number wide" })] : []), create("td", score(episode.score), { class: "number wide" }),
  ]);
}

async function load() {
  const more = by("more", HTMLButtonElement);
  more.disabled = true;
  try {
    if (!task) {
      task = await loadTask();
      showTask(task);
      by("mapped").hidden = !task.shareText;
      for (const name of all("[data-expert]")) put(name, expert());
    }
    const history = /** @type {Answers.OwnHistory} */ (await request(`me/history?limit=${PAGE}${last && `&after=${last}`}`));
    put(by("sentence"), summary(task, history));
    if (!shown) {
      by("bests").replaceChildren(...history.bests.map(bestPanel));
      if (history.total && task.expert) loadName();
    }
    by("rows").append(...history.episodes.map(episodeRow));
    shown += history.episodes.length;
    last = history.episodes.at(-1)?.episode ?? last;
    more.hidden = shown >= history.total;
    more.disabled = false;
    by("nothing").hidden = history.total > 0;
    by("history").hidden = by("keep").hidden = history.total === 0;
    by("gap").hidden = history.total === 0 || !task.expert;
    document.body.dataset.state = history.total ? "some" : "none";
  } catch (error) {
    put(by("sentence"), `${/** @type {Error} */ (error).message} Trying again.`);
    setTimeout(load, 2000);
  }
}
/** Show the name, as soon as the server says it. */
function loadName() {
  request("people").then(({ you }) => showName(you), () => setTimeout(loadName, 2000));
}
/** @param {Answers.OwnName} named */
function showName(named) {
  by("name", HTMLInputElement).value = named.name ?? "";
  by("remove-name").hidden = !named.name;
  if (named.hidden) put(by("name-note"), "The operator of this server has hidden your name: nobody sees it.");
  by("name-part").hidden = false;
  if (location.hash === "#name") by("name").focus();
}

/** Choose the name that is written, or remove it.
 * @param {object | undefined} body */
async function setName(body) {
  try {
    showName(await request("me/name", body, undefined, { method: body ? "PUT" : "DELETE" }));
    put(by("name-note"), body ? "Saved. The leaderboard shows it." : "Removed. Your episodes stay, without a name.");
  } catch (error) {
    put(by("name-note"), /** @type {Error} */ (error).message);
  }
}

/** How many of the newest episodes the curve has. */
const CURVE = 20;
/** Each of them beside Expert's, the oldest first.
 * @type {Me.Gap[]} */
const gaps = [];

/** Compare each of the newest episodes with Expert's, the oldest first, and draw the curve as it comes. */
async function compare() {
  by("compare").hidden = true;
  const { episodes } = /** @type {Answers.OwnHistory} */ (await request(`me/history?limit=${CURVE}`));
  for (const [index, { episode, outcome }] of episodes.reverse().entries()) {
    put(by("gap-note"), `Episode ${index + 1} of ${episodes.length}`);
    const costs = /** @type {Answers.Costs | null} */ (await request(`episodes/${encodeURIComponent(episode)}/costs`, undefined, 120_000).catch(() => null));
    if (!costs || costs.total === null) continue; // today's terrain
    gaps.push({ gap: costs.total, isFinished: task.successes.includes(outcome) });
    paintGaps();
  }
  put(by("gap-note"), gapsText(expert(), gaps));
}

/** Draw the finished episodes as a line, and a cross at the top for each that was not. */
function paintGaps() {
  if (!gaps.length) return;
  const chart = by("gap-chart");
  chart.hidden = false;
  const { inks, you, font } = chartColours(chart);
  const numbered = gaps.map(({ gap, isFinished }, index) => ({ at: index + 1, gap, isFinished }));
  const finished = numbered.filter(({ isFinished }) => isFinished);
  const moves = finished.map(({ gap }) => gap);
  const [low, high] = [Math.min(0, ...moves), Math.max(10, ...moves)];
  paintChart(chart, { inks, font, base: 0, edges: { left: 44, right: 14, top: 16, bottom: 22 },
    lines: [{ colour: you, dash: [], dot: 3.5, hasWhiskers: true, x: finished.map(({ at }) => at), y: moves }],
    x: { low: 0, high: gaps.length, ticks: ticks(0, gaps.length).filter(Number.isInteger), text: (at) => (at ? String(at) : "episode") }, y: { low, high, ticks: ticks(low, high), text: tickText },
    over: (context, at) => numbered.filter(({ isFinished }) => !isFinished).forEach((episode) => paintCross(context, at.x(episode.at), at.y(high) - 8, inks.text)) });
  chart.setAttribute("aria-label", gapsText(expert(), gaps));
}
/** @param {CanvasRenderingContext2D} context @param {number} x @param {number} y the middle, CSS pixels @param {string} colour */
function paintCross(context, x, y, colour) {
  context.strokeStyle = colour;
  context.lineWidth = 2;
  context.beginPath();
  for (const slope of [1, -1]) {
    context.moveTo(x - 4, y - 4 * slope);
    context.lineTo(x + 4, y + 4 * slope);
  }
  context.stroke();
}

by("compare").addEventListener("click", () => compare().catch((error) => put(by("gap-note"), error.message)));
by("name-form").addEventListener("submit", (event) => {
  event.preventDefault();
  setName({ name: by("name", HTMLInputElement).value });
});
by("remove-name").addEventListener("click", () => setName(undefined));
by("more").addEventListener("click", async () => {
  await load();
  by("more").focus({ preventScroll: true }); // which a disabled button has lost
});
addEventListener("theme", paintGaps);
new ResizeObserver(paintGaps).observe(by("gap-chart"));
load();
