// A player's own page: bests, place among people, every episode. The only module of this page that knows all the others.
import { api, request } from "../common/api.js";
import { paintDistribution } from "../common/distribution.js";
import { paintChart } from "../common/chart.js";
import { ticks, tickText } from "../common/chart_scale.js";
import { all, boardColours, by, chartColours, create, createRepaint, createSizes, put } from "../common/page.js";
import { browserStore } from "../common/storage.js";
import { tryHash } from "../play/address.js";
import { loadTask, showTask } from "../common/task.js";
import { many, percent, score } from "../common/words.js";
import { bestText, dailyText, gapsText, idleIn, idleText, isFinished, kindText, puzzlesText, standingText, summary } from "./words.js";

/** @type {Task} */
let task;
const PAGE = 50;
let shown = 0;
let last = "";

const expert = () => task.nameOf(task.expert ?? "");

/** @param {number} at_ms */
const timeText = (at_ms) => new Date(at_ms).toLocaleString(undefined, { day: "numeric", month: "short", hour: "2-digit", minute: "2-digit", hourCycle: "h23" });

/** @param {Answers.Best} figure @returns the row of one configuration */
function bestRow(figure) {
  const { best, people } = figure;
  const number = best ? [create("a", String(best.moves), { href: `watch/${encodeURIComponent(best.episode)}`, "data-testid": "best" })] : [];
  const plot = create("div");
  /** @type {Map<number, number>} */
  const counts = new Map();
  for (const mean of people.means) counts.set(Math.round(mean), (counts.get(Math.round(mean)) ?? 0) + 1);
  if (people.means.length > 1) paintDistribution(plot, { target: task.target, counts: [...counts], you: people.you });
  const name = create("div", [create("h3", figure.place), create("p", [...number, create("small", best ? " moves" : "No best yet")], { class: "moves" })], { class: "name" });
  const says = create("div", [create("p", bestText(task, figure), { class: "fine" }), create("p", standingText(task, figure), { class: "fine" })], { class: "says" });
  return create("li", [name, says, plot], { class: "best" });
}

/** @param {string} outcome @returns it in words: a success too, whose `outcome` may be a mark */
function outcomeOf(outcome) {
  if (outcome === "abandoned") return "left";
  return task.successes.includes(outcome) ? task.status(outcome) : task.outcome(outcome);
}
/** @param {Answers.OwnEpisode} episode */
const resultOf = ({ outcome, moves }) => (task.successes.includes(outcome) ? many(moves, "move") : `${outcomeOf(outcome)} after ${many(moves, "move")}`);

/** @param {Answers.OwnEpisode} episode @returns the row of one episode */
function episodeRow(episode) {
  const { outcome, moves, coverage } = episode;
  const [kind, reason] = kindText(task, episode);
  const when = create("a", timeText(episode.ended_ms), { href: `watch/${encodeURIComponent(episode.episode)}` });
  const kindCell = create("td", kind);
  kindCell.title = reason;
  return create("tr", [
    create("th", when, { scope: "row" }), create("td", episode.place), kindCell,
    create("td", outcomeOf(outcome), { class: task.successes.includes(outcome) ? "good" : outcome === "abandoned" ? "left" : "bad" }),
    create("td", [String(moves), create("small", ` ${moves === 1 ? "move" : "moves"}`)], { class: "number" }), ...(task.shareText ? [create("td", coverage === null ? "" : `${percent(coverage)} %`, { class: "number" })] : []), create("td", score(episode.score), { class: "number" }),
  ]);
}

async function load() {
  const more = by("more", HTMLButtonElement);
  more.disabled = true;
  try {
    if (!task) {
      task = await loadTask();
      showTask(task);
      by("share-title").hidden = !task.shareText;
      put(by("tries-title"), task.tries?.title ?? "");
      put(by("tries-note"), task.tries?.note ?? "");
      for (const name of all("[data-expert]")) put(name, expert());
    }
    const history = /** @type {Answers.OwnHistory} */ (await request(`me/history?limit=${PAGE}${last && `&after=${last}`}`));
    put(by("sentence"), summary(task, history));
    if (!shown) {
      by("bests").replaceChildren(...history.bests.map(bestRow));
      by("bests-part").hidden = !history.bests.length;
      if (history.total && task.expert) {
        loadName();
        if (task.has_boards) compare().catch((error) => put(by("gap-note"), error.message));
        paintPictures(history.episodes);
      }
      if (history.total) showStreaks();
    }
    by("rows").append(...history.episodes.map(episodeRow));
    shown += history.episodes.length;
    last = history.episodes.at(-1)?.episode ?? last;
    more.hidden = shown >= history.total;
    more.disabled = false;
    by("nothing").hidden = history.total > 0;
    by("history").hidden = by("keep").hidden = history.total === 0;
    by("gap").hidden = history.total === 0 || !task.expert || !task.has_boards;
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

/** How many of the newest episodes are asked for at a time to be compared. */
const NEWEST = 200;
const SOON_MS = 2000;
/** Ranked terrains beside Expert's run on each, the oldest first.
 * @type {Me.Gap[]} */
let gaps = [];

/** Draw the curve of the ranked terrains on which Expert has driven, and again while it drives on more. */
async function compare() {
  const { episodes, comparing } = /** @type {Answers.OwnHistory} */ (await request(`me/history?limit=${NEWEST}`));
  gaps = episodes.reverse().flatMap((episode) => (episode.expert_moves === null ? []
    : [{ gap: episode.moves - episode.expert_moves, isFinished: isFinished(task, episode) }]));
  put(by("gap-note"), comparing ? `${expert()} plays ${many(comparing, `more ${task.round}`)} of yours.` : gapsText(task, gaps));
  paintGaps();
  if (comparing) setTimeout(() => compare().catch(() => {}), SOON_MS);
}

/** How many of the newest replays stand there as pictures. */
const PICTURES = 6;

/** How many positions to try from stand there, and the fewest moves without anything new that make one. */
const POSITIONS = 3, IDLE_MOVES = 6;

/** The small pictures on the page.
 * @type {{place: HTMLElement, board: ReturnType<Task["boardAt"]>}[]} */
const drawn = [];
const sizes = createSizes(createRepaint(paintDrawn));

/** Draw a board as a small picture that leads somewhere.
 * @param {Element} list @param {Course} run @param {number} step @param {string} href @param {(Node | string)[]} says */
function addPicture(list, run, step, href, says) {
  const place = create("div", create("canvas", [], { role: "img" }), { class: "matrix" });
  list.append(create("li", create("a", [place, create("span", says)], { href })));
  const part = /** @type {HTMLElement} */ (list.closest("section"));
  part.hidden = false;
  drawn.push({ place, board: task.boardAt(run, step) });
  sizes.watch(place); // the part beside it comes later, and takes room
}

function paintDrawn() {
  const { you } = boardColours(document.documentElement);
  for (const { place, board } of drawn) {
    task.paint(place, board, { name: "You", accent: you, ...sizes.of(place), dpr: devicePixelRatio || 1 });
    /** @type {HTMLElement} */ (place.firstElementChild).setAttribute("aria-hidden", "true");
  }
}

/** Draw the newest episodes as pictures that lead to their replays, and positions of them from which to try again.
 * @param {Answers.OwnEpisode[]} episodes the newest first */
async function paintPictures(episodes) {
  const [pictures, positions] = [by("pictures"), by("positions")];
  for (const episode of episodes) {
    if (pictures.children.length === PICTURES) break;
    const id = episode.episode;
    const replay = await api.replay(id).catch(() => null);
    if (!replay) continue; // today's terrain, or one of another version
    const { run } = replay;
    addPicture(pictures, run, run.actions.length, `replay/${encodeURIComponent(id)}`, [resultOf(episode), create("br", []), create("small", episode.place.replaceAll(" \u00d7 ", "\u00a0\u00d7\u00a0"))]);
    if (!task.tries || positions.children.length === POSITIONS) continue;
    const idle = idleIn([...Array(run.actions.length + 1).keys()].map((step) => task.progressAt(run, step)));
    if (idle.moves < IDLE_MOVES || (await api.episode(id)).seed === null) continue;
    addPicture(positions, run, idle.after, `./${tryHash(id, idle.after)}`, [create("b", "Try from here"), ` ${idleText(idle)}`]);
  }
  by("play-on").hidden = pictures.children.length === PICTURES; // it fills the row
}

/** Say the days in a row, of the daily terrain and of the puzzles. */
async function showStreaks() {
  const [daily, puzzles] = await Promise.all([
    /** @type {Promise<Answers.Today | null>} */ (request("daily").catch(() => null)),
    /** @type {Promise<Answers.Puzzles | null>} */ (request("puzzles").catch(() => null))]);
  const answered = /** @type {Puzzles.Answered} */ (browserStore.read("humanplay.puzzles"));
  const lines = [
    ...(daily ? [[`Today's ${task.round}`, "daily", dailyText(task, daily)]] : []),
    ...(puzzles ? [["Puzzles", "puzzles", puzzlesText(puzzles, answered)]] : []),
  ];
  by("streaks").replaceChildren(...lines.map(([name, href, text]) => create("li", [create("a", name, { href }), create("span", text)])));
  by("streaks-part").hidden = lines.length === 0;
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
    x: { low: 0, high: gaps.length, ticks: ticks(0, gaps.length).filter(Number.isInteger), text: (at) => (at ? String(at) : task.round) }, y: { low, high, ticks: ticks(low, high), text: tickText },
    over: (context, at) => numbered.filter(({ isFinished }) => !isFinished).forEach((episode) => paintCross(context, at.x(episode.at), at.y(high) - 8, inks.text)) });
  chart.setAttribute("aria-label", gapsText(task, gaps));
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

by("name-form").addEventListener("submit", (event) => {
  event.preventDefault();
  setName({ name: by("name", HTMLInputElement).value });
});
by("remove-name").addEventListener("click", () => setName(undefined));
by("more").addEventListener("click", async () => {
  await load();
  by("more").focus({ preventScroll: true }); // which a disabled button has lost
});
addEventListener("theme", () => {
  paintGaps();
  paintDrawn();
});
new ResizeObserver(paintGaps).observe(by("gap-chart"));
load();
