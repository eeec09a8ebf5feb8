// The daily page: today's board, one attempt, and what it came to. The only module of this page that knows all the others.
import { api, ApiError, request, ROOT, withTask } from "../common/api.js";
import { boardColours, by, create, createRepaint, createSizes, paintLink, paintNotices, partsOf, put } from "../common/page.js";
import { paintDistribution } from "../common/distribution.js";
import { startEndCard } from "../common/end_card.js";
import { apply, initialState, isDriven } from "../common/game_state.js";
import { startBoards } from "../common/socket.js";
import { browserStore, forgets } from "../common/storage.js";
import { loadTask, paintNumbers, promptText, showTask } from "../common/task.js";
import { keepFocusOnBoard } from "../play/focus.js";
import { startInput } from "../play/input.js";
import { capital, many } from "../common/words.js";
import { bestRows, dayText, pastText, peopleText, policyRows, rankText, resultText, shareText, shownRows, streakText, untilText, whoText } from "./words.js";

let state = initialState();
/** @type {Answers.Today | null} */
let today = null;
Object.defineProperty(window, "playground", { value: Object.freeze({ get state() { return state; } }) });

const task = await loadTask();
showTask(task);
put(by("goal"), task.goal(null));
put(by("rules"), task.standing);
const modules = await task.parts?.views();
const root = by("board");
const card = startEndCard();
const part = partsOf(root);
const viewer = /** @type {HTMLIFrameElement} */ (part.viewer);
const panel = { role: /** @type {const} */ ("player"), root, part, canvas: /** @type {HTMLCanvasElement} */ (part.canvas), viewer };
const views = modules?.createViews({ panels: [panel], onChange: () => repaint() });
/** The best route of a day that is over, and one's own beside it.
 * @type {{course: Course, name: string, place: HTMLElement}[]} */
let routes = [];
const sizes = createSizes(() => {
  repaint();
  paintRoutes();
});
sizes.watch(part.matrix);
/** @type {Board | null} */
let painted = null;
const repaint = createRepaint(paint);
addEventListener("theme", () => {
  repaint();
  paintRoutes();
});

const { moves, telemetry, clock, keys } = startInput({
  task, onClock: () => (isDriven(state) ? state.player : null), board: root, settings: { repeat: by("repeat", HTMLSelectElement), sound: by("sound") }, pad: by("dock"), frames: [viewer],
  announce: (text) => { by("announcer").textContent = text; }, isPractice: () => false, isHeld: () => state.link === "connecting", onEnter: () => false,
  send: (message) => connections.send("player", message), painted: () => painted?.frame ?? null,
  driven: () => (isDriven(state) ? state.player?.frame ?? null : null),
});
const connections = startBoards({
  moves, telemetry, dispatch, isLost: () => state.link === "lost" && state.mode !== "spectator",
  async beforeRetry(_, session) {
    const about = await api.about(session);
    dispatch({ kind: "begun", about });
    return true;
  },
});
keepFocusOnBoard({ board: root, next: () => null });

function paint() {
  const { player: board, link, notices } = state;
  paintLink(by("link"), link, "live");
  paintNotices(by("notices"), notices, (id) => dispatch({ kind: "dismiss", id }));
  views?.showMatrixOnly(!board?.session);
  if (!board) return;
  const { frame } = board;
  task.paint(part.matrix, board, { name: "You", accent: boardColours(document.documentElement).you, ...sizes.of(part.matrix), dpr: devicePixelRatio || 1 });
  const { share } = paintNumbers(part, task, frame);
  put(part.outcome, task.outcome(frame.outcome));
  root.style.setProperty("--share", String(share));
  root.dataset.outcome = frame.outcome ?? "running";
  document.body.dataset.ended = String(Boolean(frame.outcome));
  document.body.dataset.state = frame.outcome ? "ended" : frame.step ? "running" : "fresh";
  put(by("prompt-text"), promptText(matchMedia("(pointer: coarse)").matches, task.keys, keys()));
  by("prompt").hidden = task.clock !== null || frame.step > 0 || Boolean(frame.outcome);
  views?.placeMap(panel, board);
  views?.load(panel, board.session || null);
  views?.paintCamera(frame);
  clock.paint();
  painted = board;
}

/** Apply an event: the only place where the state changes.
 * @param {GameEvent} event */
function dispatch(event) {
  const before = state;
  state = apply(state, event);
  if (state === before) return;
  connections.sync(state.mode === "spectator" ? { ...state, player: null } : state);
  const frame = state.player?.frame;
  if (frame && frame !== before.player?.frame) {
    const said = task.announcement(before.player?.frame ?? null, frame);
    if (said) by("announcer").textContent = said;
    if (frame.outcome && today && (before.player?.frame.outcome ?? null) === null) ended(today);
  }
  repaint();
}

/** @param {Answers.Today} of */
function ended({ day }) {
  put(by("standing"), `That was your attempt for today. The next ${task.round} comes at midnight UTC.`);
  showResults(day);
}

/** Show the board of an attempt that had ended before this page was loaded.
 * @param {string} episode */
async function showEnded(episode) {
  const watched = await api.watched(episode);
  dispatch({ kind: "watched", watched: { ...watched, episode: "" }, name: "You" });
  dispatch({ kind: "link", link: "open" });
}

/** Count down to the next terrain, by the server's clock.
 * @param {Answers.Today} of */
function startCountdown({ now_ms, next_ms }) {
  const offset_ms = now_ms - Date.now();
  const tick = () => {
    const left_ms = next_ms - Date.now() - offset_ms;
    if (left_ms > 0) put(by("countdown"), untilText(task, left_ms));
    else {
      clearInterval(timer);
      by("countdown").replaceChildren(create("a", `A new ${task.round} is here`, { href: `${ROOT}daily` }));
    }
  };
  const timer = setInterval(tick, 1000);
  tick();
}

async function begin() {
  try {
    today = /** @type {Answers.Today} */ (await request("daily"));
    put(by("day"), dayText(today.day));
    put(by("streak"), streakText(today.streak));
    paintCalendar(today.calendar);
    put(by("commitment"), today.commitment);
    startCountdown(today);
    document.body.dataset.past = String(dayInAddress(today) !== "");
    const past = showPast(today).catch((error) => {
      document.body.dataset.past = "false";
      dispatch({ kind: "notice", text: error.message });
    }).finally(() => { document.body.dataset.whole = "true"; });
    if (dayInAddress(today)) await past;
    if (document.body.dataset.past === "true") return;
    if (today.attempt?.state === "ended") await showEnded(today.attempt.episode);
    else dispatch({ kind: "begun", about: await withTask(request("daily", {})) });
  } catch (error) {
    if (!(error instanceof ApiError)) throw error;
    dispatch({ kind: "link", link: "lost" });
    if (error.status) dispatch({ kind: "notice", text: error.message });
    setTimeout(begin, 1500);
  }
}

document.body.dataset.pad = browserStore.getItem("humanplay.pad") ?? String(matchMedia("(pointer: coarse), (max-width: 700px)").matches);

/** How often policies that are still exploring are asked for. */
const ASK_AGAIN_MS = 2000;

/** Return a row of a table of results: who, and what they came to.
 * @param {string} who @param {string} what @param {"you" | "person" | "policy"} kind
 * @param {string} [episode] whose replay the row leads to */
function row(who, what, kind, episode) {
  const name = episode ? create("a", who, { href: `${ROOT}replay/${encodeURIComponent(episode)}` }) : create("span", who);
  return create("li", [name, create("b", what)], { class: kind });
}

/** @param {Daily.PolicyRow[]} rows */
const policyItems = (rows) => shownRows(rows).map(({ name, text }) => row(name, text, "policy"));

/** @param {Answers.CalendarDay[]} past the oldest first */
function paintCalendar(past) {
  by("calendar").replaceChildren(...past.map((each) => {
    const { short, long } = pastText(task, each);
    return create("li", [create("small", String(Number(each.day.slice(8))), { "aria-hidden": "true" }), create("span", short, { "aria-hidden": "true" }), create("span", long, { class: "unseen" })], { title: long, class: each.moves === null ? "bad" : "good" });
  }));
  by("calendar-part").hidden = past.length === 0;
}

/** Show the best route of a day that is over, and one's own beside it.
 * @param {string} best the episode @param {string | null} own */
async function showRoutes(best, own) {
  const courses = await Promise.all([best, ...(own && own !== best ? [own] : [])].map(async (id) => (await api.replay(id)).run));
  const figures = courses.map((course, index) => {
    const name = index || best === own ? "You" : "The best";
    const place = create("div", create("canvas", [], { role: "img", width: "0", height: "0" }), { class: "matrix" });
    return { course, name, place, figure: create("figure", [create("figcaption", `${name}: ${many(course.actions.length, "move")}`), place]) };
  });
  by("routes").replaceChildren(...figures.map(({ figure }) => figure));
  by("routes").hidden = false;
  routes = figures;
  for (const { place } of routes) sizes.watch(place);
}

function paintRoutes() {
  const { you } = boardColours(document.documentElement); // the best is a person too
  for (const { course, name, place } of routes) {
    task.paint(place, task.boardAt(course, course.actions.length), { name, accent: you, ...sizes.of(place), dpr: devicePixelRatio || 1 });
  }
}

/** Days in a row, today's among them once it is over. */
let days = 0;

/** @param {Answers.Results} results */
function paintResults({ day, attempt, people, policies }) {
  if (!attempt) return;
  const rows = policyRows(task, policies, people.you?.moves ?? null);
  const page = `${ROOT}daily/${day}`;
  card.show(state.player?.frame, {
    title: capital(resultText(task, attempt)), note: rankText(attempt, people, rows),
    share: shareText(task, day, attempt, policies, page, state.player?.progress, days),
    watch: `${ROOT}watch/${encodeURIComponent(attempt.episode)}`, play: ROOT, episodes: `${ROOT}me`,
  });
  const marks = policies.flatMap(({ name, moves }) => (moves === null || task.isInformed?.(name) ? [] : [{ name: task.nameOf(name), moves }]));
  // one person's column beside nobody's says nothing
  by("distribution").hidden = !marks.length && people.moves.reduce((sum, [, count]) => sum + count, 0) < 2;
  paintDistribution(by("distribution"), { target: task.target, counts: people.moves, you: task.successes.includes(attempt.outcome ?? "") ? attempt.moves : null, marks });
  put(by("people-note"), peopleText(task, people));
  by("policies").replaceChildren(...policyItems(rows));
  by("results").hidden = by("policies-part").hidden = false;
}

/** Show what a player's attempt came to, and the policies as soon as they are ready.
 * @param {string} day */
async function showResults(day) {
  try {
    const [found, now] = await Promise.all([/** @type {Promise<Answers.Results>} */ (request(`daily/${day}/results`)), /** @type {Promise<Answers.Today>} */ (request("daily"))]);
    days = now.streak;
    put(by("streak"), streakText(days));
    paintCalendar(now.calendar);
    paintResults(found);
    if (found.policies.some(({ state: of }) => of === "waiting" || of === "computing")) setTimeout(() => showResults(day), ASK_AGAIN_MS);
  } catch (error) {
    dispatch({ kind: "notice", text: /** @type {Error} */ (error).message });
  }
}

/** @param {Answers.Today} now @returns the past day in the address, "" where there is none */
function dayInAddress({ day }) {
  const chosen = location.pathname.split("/").at(-1) ?? "";
  return /^\d{4}-/.test(chosen) && chosen < day ? chosen : "";
}

/** Lead to the days with a terrain beside a past one; before the first there is none, and today has a link of its own.
 * @param {Answers.Day} past @param {string} nowadays */
function paintDays({ older, newer }, nowadays) {
  const before = older ? [create("a", `\u2039 ${dayText(older)}`, { href: `${ROOT}daily/${older}` })] : [];
  const after = newer && newer !== nowadays ? [create("a", `${dayText(newer)} \u203a`, { href: `${ROOT}daily/${newer}` })] : [];
  by("days").replaceChildren(...before, ...after, create("a", `Today's ${task.round}`, { class: "go", href: `${ROOT}daily` }));
  by("days").hidden = false;
}

/** Show the results of the day before, or of the past day in the address, which has the page to itself.
 * @param {Answers.Today} now */
async function showPast(now) {
  const { day: nowadays, yesterday } = now;
  const chosen = dayInAddress(now);
  const past = chosen ? /** @type {Answers.Day} */ (await request(`daily/${chosen}`)) : yesterday;
  if (!past) return;
  if (chosen) paintDays(past, nowadays);
  const { day, commitment, key } = past;
  put(by("key"), key ?? "");
  put(by("key-commitment"), commitment);
  by("key-link").setAttribute("href", `${ROOT}api/daily/${day}`);
  by("key").hidden = by("key-commitment").hidden = by("key-line").hidden = false;
  const { attempt, people, policies } = /** @type {Answers.Results} */ (await request(`daily/${day}/results`));
  const isYesterday = day === yesterday?.day;
  put(by("yesterday-title"), isYesterday ? `Yesterday, ${dayText(day)}` : dayText(day));
  if (document.body.dataset.past === "true") by("yesterday-title").setAttribute("aria-level", "1"); // it has the page to itself
  put(by("key-of"), isYesterday ? "Yesterday's key" : `The key of ${dayText(day)}`);
  const best = bestRows(task, people.table).slice(0, 5).map((level) => row(whoText(level), level.text, level.you ? "you" : "person", level.episode ?? undefined));
  by("yesterday-rows").replaceChildren(...best, ...policyItems(policyRows(task, policies.filter(({ moves }) => moves !== null), null)));
  put(by("yesterday-note"), peopleText(task, people));
  by("yesterday").hidden = false;
  const first = people.table[0]?.episode ?? null;
  const own = attempt?.state === "ended" ? attempt.episode : null;
  if (first ?? own) await showRoutes(/** @type {string} */ (first ?? own), own);
}

if (forgets()) dispatch({ kind: "notice", text: forgets(), tone: "note" });
begin();
