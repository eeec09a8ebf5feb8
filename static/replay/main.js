// Wires the page of a replay: keys, scrubber and clock -> playback -> one scheduled repaint. It runs on the server's page and in one file.
import { challengerText } from "../challenge/words.js";
import { ApiError, request } from "../common/api.js";
import { paintLegend } from "../common/chart.js";
import { all, boardColours, by, chartColours, copyOnClick, create, createRepaint, createSizes, partsOf, put } from "../common/page.js";
import { ownsKeys } from "../common/keyboard.js";
import { begun, createPlayer, SPEEDS, withLast } from "../common/player.js";
import { loadTask, paintNumbers, showTask } from "../common/task.js";
import { capital } from "../common/words.js";
import { paintCurve, startScrubber } from "./curve.js";
import { fileAddress, ghostInSearch, linkTo, moveInHash } from "./sharing.js";

const data = /** @type {ReplayData} */ (JSON.parse(by("replay-data", HTMLScriptElement).textContent ?? ""));
const task = await loadTask(data.task);
showTask(task);
const rootOf = (/** @type {string} */ name) => /** @type {HTMLElement} */ (document.querySelector(`[data-run=${name}]`));
const parts = { run: partsOf(rootOf("run")), ghost: partsOf(rootOf("ghost")) };
const select = by("ghost", HTMLSelectElement);
const scrubber = by("scrubber");
const speed = by("speed", HTMLSelectElement);

/** @type {Course | null} */
let ghost = data.ghost ?? null;
const asked = ghostInSearch(location.search);
/** @type {string | null} */
let chosen = asked === undefined ? data.preferred : asked;

Object.defineProperty(window, "replay", { value: Object.freeze({
  get step() { return player.step; }, get playback() { return player.playback; }, get ghost() { return ghost; },
}) });

const repaint = createRepaint(() => paint());
const sizes = createSizes(() => repaint());
const player = createPlayer(begun(data.run.actions.length), (playback, before) => {
  if (before.isPlaying && !playback.isPlaying) put(by("announcer"), inWords());
  repaint();
});

/** @param {Course} course @param {number} step @returns the headline without words: "45.3 %" */
function shortAt(course, step) {
  const { value, unit } = task.headline(task.boardAt(course, step).frame);
  return `${value} ${unit.split(" ")[0]}`;
}
/** @param {{you: string, policy: string}} colours */
const lines = ({ you, policy }) => [{ course: data.run, colour: you, isDashed: false }, ...(ghost ? [{ course: ghost, colour: policy, isDashed: true }] : [])];
function inWords() {
  const shares = (ghost ? [data.run, ghost] : [data.run])
    .map((course) => `${task.nameOf(course.name)} ${task.chart.say(task.progressAt(course, player.step))}`);
  return `Move ${player.step} of ${player.playback.last}: ${shares.join(", ")}`;
}

/** @param {string} name of a policy @param {unknown} error @returns what to say of a run that did not come */
function failedText(name, error) {
  if (!(error instanceof ApiError)) return `Something went wrong on this page: ${error}`;
  return error.status === 503 ? `${name} did not finish this ${task.round} in time.` : capital(error.message);
}

/** @type {Answers.Advice[] | null} what Expert would do before each move of the run: null until it is asked for */
let expert = null;
const judge = task.nameOf(task.expert ?? "");
const judgeName = document.getElementById("expert-name");
if (judgeName) put(judgeName, judge);
const thinks = /** @type {HTMLInputElement | null} */ (document.getElementById("expert"));
/** @param {string} text what stands beside the switch, until the moves are there */
function sayOfExpert(text) {
  put(by("advice"), text);
  put(by("announcer"), text);
}
async function askExpert() {
  put(by("advice"), "");
  repaint();
  if (!thinks?.checked || expert) return;
  sayOfExpert(`${judge} plays on from every move of this episode. That can take a minute on a large board.`);
  try {
    const costs = /** @type {{expert: Answers.Advice[], reason: string | null}} */ (await request(`episodes/${encodeURIComponent(data.episode)}/costs`, undefined, 600_000));
    if (costs.reason !== null) return thinks.checked && sayOfExpert(`${capital(costs.reason)}.`);
    expert = costs.expert;
    repaint();
  } catch (error) {
    if (thinks.checked) sayOfExpert(failedText(judge, error));
  }
}
/** @param {number} step @returns what Expert thinks there, where it is to be shown */
const adviceAt = (step) => (thinks?.checked ? expert?.[step] : undefined);

/** Paint a run as it stood after `step` moves.
 * @param {Record<string, HTMLElement>} part @param {Course} course @param {number} step
 * @param {Pick<Look, "accent" | "dpr"> & {shares?: number[], other: {course: Course, accent: string} | null}} look other is the
 *   run whose path is drawn dashed */
function paintRun(part, course, step, { other, ...look }) {
  const board = task.boardAt(course, step);
  const ghost = other && { trail: task.boardAt(other.course, step).trail, accent: other.accent };
  const whole = { ...look, name: task.nameOf(course.name), ...sizes.of(part.ground), ghost };
  task.paint(part.ground, board, whole);
  task.paintEvents?.(part.ground, course, step, whole);
  const { outcome } = board.frame;
  paintNumbers(part, task, board.frame);
  put(part.outcome, outcome ? course.sentence : task.status(null));
  part.outcome.dataset.outcome = outcome ?? "";
}

function paint() {
  const step = player.step;
  const dpr = window.devicePixelRatio || 1;
  const { you, policy } = boardColours(scrubber);
  paintRun(parts.run, data.run, step, { accent: you, other: ghost && { course: ghost, accent: policy }, dpr, shares: adviceAt(step)?.shares ?? undefined });
  if (ghost) paintRun(parts.ghost, ghost, step, { accent: policy, other: { course: data.run, accent: you }, dpr });
  const colours = chartColours(scrubber);
  paintCurve(scrubber, task, lines(colours), { step, last: player.playback.last });
  paintLegend(by("legend"), lines(colours).map(({ course, colour, isDashed }) => ({ name: task.nameOf(course.name), colour, dash: isDashed ? "9 4" : "" })));
  put(by("play"), player.playback.isPlaying ? "Pause" : step >= player.playback.last ? "Again" : "Play");
  put(by("at"), `move ${step} of ${player.playback.last}`);
  put(by("run-tab-share"), shortAt(data.run, step));
  put(by("ghost-tab-share"), ghost ? shortAt(ghost, step) : "");
  const advice = adviceAt(step);
  if (expert && thinks?.checked) put(by("advice"), advice ? task.adviceText?.(advice, data.run, step) ?? "" : "The episode has ended here.");
  speed.value = String(player.playback.speed);
  scrubber.setAttribute("aria-valuemax", String(player.playback.last));
  scrubber.setAttribute("aria-valuenow", String(step));
  scrubber.setAttribute("aria-valuetext", inWords());
}

/** How long a policy may play an episode, and after how long the page says that it is getting ready, in ms. */
const GHOST_MS = 200_000, LATE_MS = 8000;

/** Show a policy's course, or none.
 * @param {Course | null} course */
function showGhost(course) {
  ghost = course;
  document.body.dataset.ghost = String(chosen !== null);
  by("tabs").hidden = chosen === null;
  put(by("ghost-tab-name"), task.nameOf(chosen ?? ""));
  put(by("compared"), course ? `${task.nameOf(course.name)} ${course.sentence} on the same ${task.round}.` : "");
  player.show(withLast(player.playback, Math.max(data.run.actions.length, course ? course.actions.length : 0)));
}
/** Say that a policy's run did not come, also where its board is not on the screen, and offer it again.
 * @param {string} name @param {unknown} error */
function showFailure(name, error) {
  const text = failedText(task.nameOf(name), error);
  const again = create("button", "Try again", { type: "button", class: "quiet", "data-testid": "try-again" });
  again.addEventListener("click", () => choose(name));
  by("waiting").replaceChildren(create("span", text), again);
  put(by("compared"), text);
  if (thinks?.checked && !expert) sayOfExpert(""); // it would say beside this that the policy plays on
}
/** @param {string | null} name */
async function choose(name) {
  chosen = name;
  for (const link of /** @type {NodeListOf<HTMLAnchorElement>} */ (document.querySelectorAll("[data-format]"))) link.href = fileAddress(data.episode, link.dataset.format ?? "", name);
  if (name === null || data.ghost) return showGhost(name === null ? null : data.ghost ?? null);
  const waiting = by("waiting");
  parts.ghost.canvas.hidden = true;
  waiting.hidden = false;
  put(waiting, `${task.nameOf(name)} plays the same ${task.round}\u2026`);
  showGhost(null);
  const late = setTimeout(() => { if (chosen === name) put(waiting, `${task.nameOf(name)} is getting ready. That can take a minute at first.`); }, LATE_MS);
  try {
    const course = /** @type {Course} */ (await request(`episodes/${encodeURIComponent(data.episode)}/ghost?${new URLSearchParams({ policy: name })}`, undefined, GHOST_MS));
    if (chosen !== name) return;
    waiting.hidden = true;
    parts.ghost.canvas.hidden = false;
    showGhost(course);
  } catch (error) {
    if (chosen === name) showFailure(name, error);
  } finally {
    clearTimeout(late);
  }
}

select.replaceChildren(...data.ghosts.map((name) => create("option", task.nameOf(name), { value: name })), create("option", "no policy", { value: "" }));
select.value = chosen ?? "";
select.addEventListener("change", () => choose(select.value || null));
speed.append(...SPEEDS.map((each) => create("option", `${each} moves/s`, { value: String(each) })));
speed.addEventListener("change", () => player.show({ ...player.playback, speed: Number(speed.value) }));
for (const button of all("[data-key]")) button.addEventListener("click", () => player.press(button.dataset.key ?? ""));
window.addEventListener("keydown", (event) => {
  const target = /** @type {HTMLElement | null} */ (event.target);
  if (event.ctrlKey || event.metaKey || event.altKey || (target !== scrubber && ownsKeys(target))) return;
  if (event.key === " " && target?.matches("button, a, summary, input")) return; // the button's own
  if (player.press(event.key, event.shiftKey)) event.preventDefault();
});
startScrubber(scrubber, { last: () => player.playback.last, onMove: player.goTo, onHover: player.hover });
for (const button of all("[data-tab]")) {
  button.addEventListener("click", () => {
    document.body.dataset.tab = button.dataset.tab;
    for (const each of all("[data-tab][aria-pressed]")) each.setAttribute("aria-pressed", String(each === button));
    repaint();
  });
}
thinks?.addEventListener("change", askExpert);
const address = () =>
  linkTo(location.href, { ghost: chosen, preferred: data.preferred, step: player.step, last: player.playback.last });
const copy = document.getElementById("copy-link");
if (copy) copyOnClick(copy, address, (text) => put(by("announcer"), text));
for (const each of [parts.run.ground, parts.ghost.ground, scrubber]) sizes.watch(each);
for (const what of ["theme", "resize"]) window.addEventListener(what, () => repaint());

const taken = document.getElementById("challengers"); // a page in one file has none
if (taken) {
  /** @type {Promise<Answers.Challenger[]>} */ (request(`episodes/${encodeURIComponent(data.episode)}/challengers`)).then((people) => {
    put(taken, people.length ? `${people.slice(0, 3).map(challengerText).join("; ")}.` : "");
  }, () => {});
}
document.body.dataset.tab = "run";
const wanted = moveInHash(location.hash);
if (wanted !== null) player.goTo(wanted); // as far as the run itself goes, until the policy's has come
const { at } = player.playback;
await choose(chosen);
if (player.playback.at === at && !player.playback.isPlaying) { // else somebody drives it already
  if (wanted !== null) player.goTo(wanted);
  else if (!matchMedia("(prefers-reduced-motion: reduce)").matches) player.press(" ");
}
