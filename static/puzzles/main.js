// The puzzles of the day: a position, its next move to choose, and what it saves. The only module of this page that knows all the others.
import { request, ROOT } from "../common/api.js";
import { codesOf, ownsKeys, actionOf } from "../common/keyboard.js";
import { chosenKeys } from "../common/keymap.js";
import { boardColours, by, copyOnClick, create, createRepaint, createSizes, put } from "../common/page.js";
import { browserStore, forgets } from "../common/storage.js";
import { loadTask } from "../common/task.js";
import { countdown, dayText, streakText } from "../daily/words.js";
import { many } from "../common/words.js";
import * as words from "./words.js";

/** By day, what was chosen; nothing of it leaves the browser. */
const ANSWERED = "humanplay.puzzles";

/** @type {Task} */
let task;
/** @type {Answers.Puzzles | null} */
let today = null;
/** @type {Record<string, Answers.PuzzleAnswer>} of those that were answered */
const answers = {};
let number = 0;
let shown_ms = 0;
Object.defineProperty(window, "puzzles", { value: Object.freeze({ get today() { return today; }, get number() { return number; } }) });

const stored = () => /** @type {Puzzles.Answered} */ (browserStore.read(ANSWERED));
const choices = () => (today ? words.choicesOn(stored(), today.day) : []);
const puzzle = () => today?.puzzles[number];
/** @returns {Puzzles.Choice | undefined} what was chosen here */
const chosen = () => choices().find(({ id }) => id === puzzle()?.id);
const sizes = createSizes(() => repaint());
const repaint = createRepaint(paint);
const matrix = by("matrix");
sizes.watch(matrix);
addEventListener("theme", () => repaint());

/** @param {Answers.Puzzle} shown @param {string | undefined} answer chosen */
function paintBoard({ id, frame, trail }, answer) {
  const best = answers[id]?.best;
  const missed = answer && best ? words.cellsLeft(answer, answers[id]) : [];
  const mistake = { step: 0, position: trail[trail.length - 1], action: answer, expert_action: best, missed };
  const marks = answer && best ? { mistakes: [mistake], chosen: 0, hasNumbers: false } : null;
  const accent = boardColours(matrix).you;
  const board = { session: "", name: "", frame, trail, progress: [], hasGap: false, pace: null, isReplay: false };
  task.paint(matrix, /** @type {Board} */ (/** @type {unknown} */ (board)), { name: "The puzzle", accent, has_range: true, marks, ...sizes.of(matrix), dpr: devicePixelRatio || 1 });
}

function paint() {
  const shown = puzzle();
  if (!today || !shown) return;
  const choice = chosen();
  const answer = choice && answers[shown.id];
  paintBoard(shown, choice?.answer);
  put(by("number"), `Puzzle ${number + 1} of ${today.puzzles.length}`);
  put(by("moves"), `${many(shown.trail.length - 1, "move")} made`);
  for (const button of /** @type {NodeListOf<HTMLButtonElement>} */ (document.querySelectorAll("[data-action]"))) {
    const action = button.dataset.action ?? "";
    button.disabled = Boolean(choice) || !shown.moves.includes(action);
    button.dataset.is = !choice ? "" : action === answer?.best ? "best" : action === choice.answer ? "chosen" : "";
  }
  by("question").hidden = Boolean(choice);
  by("verdict").hidden = !answer;
  put(by("why"), choice && answer ? words.whyText(choice.answer, answer) : "");
  if (choice && answer) {
    put(by("verdict-title"), words.verdictText(choice.answer, answer));
    by("verdict-title").dataset.isRight = String(choice.answer === answer.best);
    put(by("verdict-text"), words.savesText(choice.answer, answer));
  }
  const isLast = choices().length >= today.puzzles.length;
  by("next").hidden = !choice || isLast;
  by("done").hidden = !isLast;
  by("share").hidden = choices().some(({ id }) => !answers[id]); // until it is known what was right
  put(by("done-text"), words.doneText(choices(), answers));
  put(by("streak"), streakText(words.streak(stored(), today.day, today.puzzles.length)));
  by("dots").replaceChildren(...today.puzzles.map((each, index) => {
    const made = choices().find(({ id }) => id === each.id);
    const state = made && answers[each.id] ? (made.answer === answers[each.id].best ? "right" : "wrong") : made ? "answered" : "open";
    const button = create("button", String(index + 1), { type: "button", class: "quiet", "data-state": state, "aria-label": `Puzzle ${index + 1}: ${state}`, "aria-pressed": String(index === number) });
    button.addEventListener("click", () => show(index));
    return create("li", button);
  }));
}

/** @param {number} index of the day's puzzles */
function show(index) {
  number = index;
  shown_ms = performance.now();
  repaint();
}

/** @param {string} id */
async function loadAnswer(id) {
  answers[id] = await request(`puzzles/${encodeURIComponent(id)}/answer`);
  repaint();
}

/** @param {string} action */
async function choose(action) {
  const shown = puzzle();
  if (!today || !shown || chosen() || !shown.moves.includes(action)) return;
  const choice = { id: shown.id, answer: action, ms: Math.round(performance.now() - shown_ms) };
  browserStore.setItem(ANSWERED, JSON.stringify({ ...stored(), [today.day]: [...choices(), choice] }));
  repaint();
  await retried(() => loadAnswer(shown.id));
  by("next").focus({ preventScroll: true });
}
function next() {
  if (!today) return;
  const open = today.puzzles.findIndex(({ id }) => !choices().some((choice) => choice.id === id));
  if (open >= 0) show(open);
}

/** Try until the server answers.
 * @param {() => Promise<void>} work */
async function retried(work) {
  for (;;) {
    try {
      await work();
      return put(by("status"), forgets());
    } catch (error) {
      const { status, message } = /** @type {{status?: number, message: string}} */ (error);
      put(by("status"), status === 404 ? message : `${message} Trying again.`);
      if (status === 404) throw error;
      await new Promise((done) => { setTimeout(done, 1500); });
    }
  }
}

/** @param {Answers.Puzzles} of */
function startCountdown({ now_ms, next_ms }) {
  const offset_ms = now_ms - Date.now();
  const tick = () => {
    const left_ms = next_ms - Date.now() - offset_ms;
    if (left_ms > 0) return put(by("countdown"), `The next three come in ${countdown(left_ms)}.`);
    clearInterval(timer);
    by("countdown").replaceChildren(create("a", "Three new ones are here", { href: "puzzles" }));
  };
  const timer = setInterval(tick, 1000);
  tick();
}

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.repeat || ownsKeys(/** @type {HTMLElement} */ (event.target))) return;
  const action = task && codesOf(event).map((code) => actionOf(chosenKeys(task), code)).find(Boolean);
  if (!action) return;
  event.preventDefault();
  choose(action);
});
for (const button of /** @type {NodeListOf<HTMLButtonElement>} */ (document.querySelectorAll("[data-action]"))) button.addEventListener("click", () => choose(button.dataset.action ?? ""));
by("next").addEventListener("click", next);
copyOnClick(by("share"), () => words.shareText(task.title, dayText(today?.day ?? ""), choices(), answers, `${ROOT}puzzles`), (text) => put(by("announcer"), text), { done: "Copied", byHand: "Copy this text:" });

await retried(async () => {
  task ??= await loadTask();
  put(by("goal"), task.goal(null));
  const loaded = /** @type {Answers.Puzzles} */ (await request("puzzles"));
  await Promise.all(words.choicesOn(stored(), loaded.day).map(({ id }) => loadAnswer(id)));
  today = loaded;
}).then(() => {
  put(by("day"), dayText(/** @type {Answers.Puzzles} */ (today).day));
  startCountdown(/** @type {Answers.Puzzles} */ (today));
  document.body.dataset.state = "ready";
  show(0);
  next();
}, () => {});
