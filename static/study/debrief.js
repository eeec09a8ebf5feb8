// The debrief: own figures, own trials as bars, and the replay of a warm-up terrain next to a policy's.
import { create, by, put } from "../common/page.js";
import { begun, createPlayer, stepOf } from "../common/player.js";
import { lengthOf } from "../common/task.js";
import { fixed, t } from "../common/texts.js";
import { capital, movesText, score } from "../common/words.js";
import { screenOf } from "./state.js";
import { dispatch, state, study } from "./store.js";
import * as words from "./words.js";

/** Moves per second. */
const SPEED = 6.25;

/** @param {Task} task @returns what it calls a round, for sentences */
const rounds = ({ round }) => ({ round, Round: capital(round) });

/** @type {ReturnType<typeof createPlayer> | null} */
let player = null;
/** @type {Task} */
let task;

/** Load both runs of a terrain: the warm-up ones first, then the ranked ones, which a closed study shows.
 * @param {number} index */
export async function load(index) {
  const warmUps = state.participant?.debrief?.warm_up_terrains ?? 0;
  const phase = index < warmUps ? "warm_up" : "ranked";
  const number = phase === "ranked" ? index - warmUps : index;
  try {
    by("own-costs").replaceChildren();
    show(index, await study.terrain(number, phase));
    const costs = task.costsInWords ? await study.costs(number, phase).catch(() => null) : null; // a busy server: nothing is shown
    if (costs && state.replay?.index === index) paintCosts(by("own-costs"), costs, ({ step }) => player?.goTo(step));
  } catch (error) {
    dispatch({ kind: "notice", text: /** @type {Error} */ (error).message });
  }
}
/** Show the runs of a terrain from their start.
 * @param {number} index @param {Answers.DebriefRuns} answer */
function show(index, { own, policy }) {
  const runs = { own: task.courseOf(t("debrief.you", "You"), own), policy: task.courseOf(task.nameOf(policy.name), policy.frames) };
  const last = Math.max(0, ...Object.values(runs).map((course) => (course ? course.actions.length : 0)));
  player?.goTo(0); // the clock of the one before stops
  player = createPlayer(begun(last, task.clock ?? SPEED), (playback) =>
    dispatch({ kind: "replay-moved", replay: { index, runs, playback } }));
  player.goTo(0);
}
by("replay-play").addEventListener("click", () => player?.press(" "));
by("replay-step").addEventListener("click", () => player?.press("ArrowRight"));
by("replay-at").addEventListener("input", () => player?.goTo(Number(by("replay-at", HTMLInputElement).value)));
by("replay-index").addEventListener("change", () => load(Number(by("replay-index", HTMLSelectElement).value)));

/** @param {Answers.Debrief} debrief */
function paintFigures(debrief) {
  const { episodes, mean_score, mean_steps, warm_up_terrains: terrains, ranked_terrains: ranked } = debrief;
  put(by("own-score"), score(mean_score));
  put(by("own-steps"), mean_steps === null ? "\u2013" : fixed(mean_steps, 1));
  const completed = episodes.filter(({ outcome }) => task.successes.includes(outcome ?? "")).length;
  put(by("own-finished"), t("block.step_of", "{number} of {of}", { number: completed, of: episodes.length }));
  put(by("debrief-line"), words.debriefLine(task, debrief));
  by("trials").replaceChildren(create("h2", t("debrief.by_round", "{Round} by {round}", rounds(task))), trialTable(episodes));
  const choice = by("replay-index", HTMLSelectElement);
  put(by("replay-label"), ranked ? t("debrief.round", "{Round}", rounds(task)) : t("debrief.warm_up_round", "Warm-up {round}", rounds(task)));
  if (choice.options.length !== terrains + ranked) {
    const plain = t("block.step_of", "{number} of {of}");
    const named = (/** @type {number} */ count, /** @type {string} */ text, /** @type {number} */ first) =>
      Array.from({ length: count }, (_, index) => new Option(text.replace("{number}", String(index + 1)).replace("{of}", String(count)), String(first + index)));
    choice.replaceChildren(...named(terrains, ranked ? t("debrief.nth_warm_up", "warm-up {number} of {of}") : plain, 0),
      ...named(ranked, t("debrief.nth_ranked", "ranked {number} of {of}"), terrains));
  }
}
/** @param {Answers.Debrief["episodes"]} episodes @returns a table with a row for each trial, its score as a bar */
function trialTable(episodes) {
  const length = task.clock ? t("play.seconds", "Seconds") : t("play.moves", "Moves");
  const head = [t("debrief.round", "{Round}", rounds(task)), t("debrief.outcome", "Outcome"), length, t("play.score", "Score")].map((text) => create("th", text, { scope: "col" }));
  const rows = episodes.map(({ trial, outcome, steps, score: value }) => {
    const bar = create("i", [], { style: `--share: ${Math.max(0, Math.min(1, value))}` });
    return create("tr", [create("th", String(trial + 1), { scope: "row" }), ...[[task.status(outcome)], [lengthOf(task, steps)], [bar, score(value)]].map((cell) => create("td", cell))]);
  });
  return create("table", [create("thead", create("tr", head)), create("tbody", rows)], { class: "bars" });
}
/** @param {Study.Replay} replay @param {Study.Look} look */
function paintReplay({ index, runs, playback }, { palette, accent, rival }) {
  const step = stepOf(playback);
  put(by("policy-name"), runs.policy?.name ?? "");
  put(by("replay-play"), playback.isPlaying ? t("debrief.pause", "Pause") : t("debrief.play", "Play"));
  by("replay-index", HTMLSelectElement).value = String(index);
  const slider = by("replay-at", HTMLInputElement);
  slider.max = String(playback.last);
  slider.value = String(step);
  slider.setAttribute("aria-valuetext", t("debrief.move_of", "move {number} of {of}", { number: step, of: playback.last }));
  for (const [run, course] of Object.entries(runs)) {
    if (!course) continue;
    const place = /** @type {HTMLElement} */ (by(`${run}-board`).parentElement);
    const board = task.boardAt(course, step);
    const { step: moves, outcome } = board.frame;
    place.style.aspectRatio = task.shape(board.frame).join(" / ");
    task.paint(place, board, { name: course.name, palette, accent: run === "own" ? accent : rival, width_px: place.clientWidth,
      height_px: place.clientHeight, dpr: devicePixelRatio || 1 });
    const { value, unit } = task.headline(board.frame);
    put(by(`${run}-now`), `${task.clock ? `${lengthOf(task, moves)} s` : movesText(moves)}, ${value} ${unit.split(" ")[0]}${outcome ? `, ${task.status(outcome)}` : ""}`);
  }
}

/** @param {Study.State | null} before @param {Study.Look} look */
export function paintDebrief(before, look) {
  if (screenOf(state) !== "debrief" || !state.participant?.debrief) return;
  ({ task } = state.participant);
  const isNew = before === null || screenOf(before) !== "debrief";
  if (isNew || state.participant !== before.participant) paintFigures(state.participant.debrief);
  put(by("finish"), state.looksBack ? t("debrief.back", "Back to the end") : words.finish(state.participant));
  by("replay").hidden = state.replay === null;
  if (state.replay && (isNew || state.replay !== before.replay)) paintReplay(state.replay, look);
}

/** Fill a place with what the moves of an episode cost, the greatest mistake first, each with a button.
 * @param {HTMLElement} place @param {Answers.Costs} costs @param {(mistake: Mars.Mistake) => void} onChoose */
async function paintCosts(place, costs, onChoose) {
  const costsInWords = await task.costsInWords?.(costs);
  if (!costsInWords) return;
  const list = costsInWords.mistakes.map((sentence, index) => {
    const mistake = costs.mistakes[index];
    const choose = create("button", t("debrief.show", "Show"), { type: "button", class: "quiet", "aria-label": t("debrief.show_move", "Show: move {number}", { number: mistake.step + 1 }) });
    choose.addEventListener("click", () => onChoose(mistake));
    return create("li", [`${sentence} `, choose]);
  });
  place.replaceChildren(create("p", costsInWords.summary), create("ol", list), ...costsInWords.rest.map((text) => create("p", text)));
}
