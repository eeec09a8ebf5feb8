// Wires the leaderboard: address -> question -> answer -> one repaint; asks again while policies are being evaluated.
import { request } from "../common/api.js";
import { all, by, create, put, reader } from "../common/page.js";
import { loadTask, showTask } from "../common/task.js";
import { paintPeople } from "./people.js";
import { breakOf, GRADIENT, invitation, paintCoverage, paintMaps, paintRanks, paintTrials, scaleOf, topOf } from "./ranks.js";
import * as standing from "./standing.js";

const boardSelect = by("board", HTMLSelectElement);
const task = await loadTask();
showTask(task);
const SOON_MS = 1500;
const LATER_MS = 20000;

/** @type {Leaderboard.State} */
let state = { view: location.hash || !task.expert ? "policies" : "people", boards: [], ...fromAddress(), detail: null, evaluates: false };
let timer = 0;
/** @type {"week" | "all"} */
let period = "week";
Object.defineProperty(window, "playground", { value: Object.freeze({ get state() { return state; } }) });

/** Return what the address asks for: `#random-21x21&score`. */
function fromAddress() {
  const [board, measure] = decodeURIComponent(location.hash.slice(1)).split("&");
  return { board, measure: /** @type {Leaderboard.Measure} */ (measure === "score" ? "score" : "steps") };
}

/** @param {Partial<typeof state>} change */
function set(change) {
  state = { ...state, ...change };
  const isAsked = state.view === "policies";
  history.replaceState(null, "", isAsked ? `#${encodeURIComponent(state.board)}${state.measure === "score" ? "&score" : ""}` : location.pathname);
  paint();
}

/** Show the people, or people beside policies.
 * @param {Leaderboard.View} view */
function show(view) {
  document.body.dataset.view = view;
  for (const button of all("[data-view][aria-pressed]")) button.setAttribute("aria-pressed", String(button.dataset.view === view));
  set({ view });
  load();
}

async function loadPeople() {
  const wanted = period;
  const answer = /** @type {Answers.People} */ (await request(`people?period=${period}`));
  if (wanted !== period) return;
  put(by("people-place"), answer.title);
  put(by("fewest"), String(answer.fewest));
  put(by("most-behind"), String(answer.most_behind));
  by("people-rules").hidden = false;
  paintPeople(by("named", HTMLTableElement), by("own"), task, period, answer);
  schedule(answer.comparing ? SOON_MS : LATER_MS);
}

async function load() {
  clearTimeout(timer);
  if (state.view === "people") return loadPeople().catch((error) => { by("own").textContent = `${error.message} Trying again.`; schedule(2 * SOON_MS); });
  try {
    if (state.boards.length === 0) await loadBoards();
    const wanted = state.board;
    /** @type {Answers.Leaderboard} */
    const detail = await request(`leaderboard/${encodeURIComponent(state.board)}${state.evaluates ? "?evaluate=true" : ""}`, undefined, 60000);
    if (wanted !== state.board) return;
    set({ detail });
    schedule(standing.working(task, detail.policies) ? SOON_MS : LATER_MS);
  } catch (error) {
    by("sentence").textContent = `${/** @type {Error} */ (error).message} Trying again.`;
    schedule(2 * SOON_MS);
  }
}

async function loadBoards() {
  /** @type {Answers.LeaderboardEntry[]} */
  const boards = await request("leaderboard");
  state = { ...state, boards, board: boards.some(({ id }) => id === state.board) ? state.board : boards[0].id };
  const [studies, rest] = [boards.filter((each) => each.study), boards.filter((each) => !each.study)];
  /** @type {[string, Answers.LeaderboardEntry[]][]} */
  const parts = [["Studies", studies], ["Played by people", rest.filter((each) => each.players)],
    ["Not yet played by people", rest.filter((each) => !each.players)]];
  boardSelect.replaceChildren(...parts.filter(([, members]) => members.length)
    .map(([label, members]) => create("optgroup", members.map(({ id, title }) => new Option(title, id)), { label })));
}

/** @param {number} ms */
function schedule(ms) {
  clearTimeout(timer);
  timer = setTimeout(() => (document.hidden ? schedule(ms) : load()), ms);
}

function paint() {
  boardSelect.value = state.board;
  for (const button of all("[data-measure]")) button.setAttribute("aria-pressed", String(button.dataset.measure === state.measure));
  const { detail, measure } = state;
  if (!detail || detail.board.id !== state.board) return;
  const read = reader(document.documentElement);
  const rows = standing.rows(task, detail, measure).map((row) => ({ ...row, colour: read(row.colour) }));
  const figures = rows.flatMap(({ figure }) => (figure ? [figure] : []));
  by("sentence").textContent = standing.headline(task, detail);
  [by("reading-people").textContent, by("reading-policies").textContent] = standing.reading(task, detail);
  by("measure-name").textContent = measure === "steps" ? `Moves to ${task.target}, fewer is better` : "Score, more is better";
  paintWorking(standing.working(task, detail.policies));
  by("missing").hidden = !detail.policies.some((policy) => policy.state === "missing");
  const scale = scaleOf(figures, measure);
  paintRanks(by("ranks", HTMLTableElement), by("ticks"), task, rows, scale, measure);
  if (!detail.people) by("ranks", HTMLTableElement).tBodies[0].append(invitation(detail.board));
  by("ranks-note").textContent = standing.ranksNote(task, detail, breakOf(scale) !== null);
  /** @type {HTMLElement} */ (document.querySelector(".coverage")).hidden = figures.length > 0 && !figures.some(({ curve }) => curve);
  paintCoverage({ chart: by("coverage"), legend: legendOf("coverage"), note: by("coverage-note") }, task, rows);
  by("trials-part").hidden = !detail.people?.trials.length;
  paintTrials({ chart: by("trials"), legend: legendOf("trials"), note: by("trials-note") }, task,
    detail.people?.trials ?? [], rows, measure);
  paintVisits(rows);
}

/** @param {ReturnType<typeof standing.working>} work */
function paintWorking(work) {
  const place = by("working");
  place.hidden = !work;
  if (!work) return;
  const bar = create("progress", [], { max: String(work.of), value: String(work.done), "aria-label": "Evaluation of all policies" });
  place.replaceChildren(create("span", work.text), bar);
}

const legendOf = (/** @type {string} */ chart) => /** @type {HTMLElement} */ (by(chart).closest("section")?.querySelector(".legend"));

/** @param {Leaderboard.Row[]} rows */
function paintVisits(rows) {
  const peopleFirst = [...rows].sort((a, b) => Number(b.who === "people") - Number(a.who === "people"));
  const maps = peopleFirst.flatMap(({ name, colour, figure }) => (figure?.visits ? [{ name, colour, visits: figure.visits }] : []));
  paintMaps(by("visits"), task, maps);
  /** @type {HTMLElement} */ (document.querySelector(".visits")).hidden = rows.some(({ figure }) => figure) && !maps.length;
  const note = by("visits-note");
  note.textContent = maps.length ? "Visits of a cell in a mean episode, all on one scale (square root): 0" : "No figures yet.";
  if (!maps.length) return;
  note.append(create("span", [], { class: "scale-key", style: `background: ${GRADIENT}` }), `${topOf(maps).toFixed(1)} and more. Every episode begins in the north-west corner.`);
}

boardSelect.addEventListener("change", () => { set({ board: boardSelect.value, detail: null, evaluates: false }); load(); });
by("evaluate").addEventListener("click", () => { set({ evaluates: true }); load(); });
for (const button of all("[data-measure]")) button.addEventListener("click", () => set({ measure: /** @type {Leaderboard.Measure} */ (button.dataset.measure) }));
addEventListener("theme", () => paint());
for (const button of all("[data-period]")) {
  button.addEventListener("click", () => {
    period = button.dataset.period === "all" ? "all" : "week";
    for (const other of all("[data-period]")) other.setAttribute("aria-pressed", String(other === button));
    load();
  });
}
for (const button of all("button[data-view]")) button.addEventListener("click", () => show(/** @type {Leaderboard.View} */ (button.dataset.view)));
new ResizeObserver(() => paint()).observe(by("coverage"));
put(by("by-steps"), `Moves to ${task.target}`);
for (const name of all("[data-expert]")) put(name, task.nameOf(task.expert ?? ""));
/** @type {HTMLElement} */ (document.querySelector(".views")).hidden = !task.expert;
show(state.view);
