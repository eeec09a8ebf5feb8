// Any environment, shown as its own picture and told in the words of its description.
import { span, ticks, tickText } from "../../common/chart_scale.js";
import { create } from "../../common/page.js";
import { fixed, t } from "../../common/texts.js";
import { actionText, capital, many, movesText, score } from "../../common/words.js";

/** A picture with a shorter side, pixels, is enlarged without smoothing, from twice its size on. */
const SMALL = 256;

const FAILED = t("picture.failed", "It failed twice at the next move, which was not your doing. The round counts up to there.");

/** @param {number | null | undefined} clock @param {number} step @returns how long it took: "12 moves", or "3.5 s" where time runs */
const took = (clock, step) => (clock ? `${fixed(step / clock, 1)} s` : movesText(step));

/** @param {string | null} outcome @returns an outcome as it stands on a page: "timed out" */
const words = (outcome) => OUTCOMES[outcome ?? ""] ?? (outcome ?? "").replaceAll("_", " ");

/** @type {Readonly<Record<string, string>>} */
const OUTCOMES = Object.freeze({
  succeeded: t("picture.succeeded", "succeeded"), terminated: t("picture.terminated", "terminated"), truncated: t("picture.truncated", "truncated"),
  timed_out: t("picture.timed_out", "timed out"), abandoned: t("picture.abandoned", "abandoned"),
  environment_failed: t("picture.environment_failed", "environment failed"),
});

/** @param {Answers.Task} about @returns the actions that have a key */
const reached = ({ actions, keys }) => actions.filter((action) => keys[action]?.length);

/** Show a picture as large as its place, a small one in whole multiples from twice its size on.
 * @param {HTMLElement} place @param {{frame: Picture.Frame}} board @param {Look} look @param {number | null} [clock] */
function paint(place, { frame }, { name, width_px, height_px, dpr }, clock = null) {
  const canvas = place.querySelector("canvas");
  if (canvas) canvas.hidden = true;
  const shown = frame.picture;
  if (shown === null) {
    const pre = place.querySelector("pre.picture") ?? place.appendChild(create("pre", [], { class: "picture", "data-testid": "picture" }));
    pre.textContent = frame.text;
    return;
  }
  const img = /** @type {HTMLImageElement} */ (place.querySelector("img.picture") ?? place.appendChild(create("img", [], { class: "picture", "data-testid": "picture", decoding: "sync" })));
  const alt = `${name}: ${inWords(frame, clock).line}`;
  if (!clock || frame.step === 0 || frame.outcome) img.alt = alt; // no picture is told 60 times a second
  const fit = () => {
    const { naturalWidth: width, naturalHeight: height } = img;
    const scale = Math.min(width_px / width, height_px / height);
    const isSharp = Math.min(width, height) <= SMALL && scale * dpr >= 2, whole = isSharp ? Math.floor(scale * dpr) / dpr : scale;
    if (!(whole > 0 && Number.isFinite(whole))) return;
    Object.assign(img.style, { width: `${width * whole}px`, height: `${height * whole}px`, imageRendering: isSharp ? "pixelated" : "auto" });
  };
  img.onload = fit;
  if (img.src !== shown) img.src = shown;
  if (img.complete) fit();
}

/** @param {Picture.Frame} frame @param {number | null} [clock] */
function inWords({ text, step, outcome }, clock) {
  const rows = (text ?? "").split("\n").filter(Boolean);
  return { line: [...rows, after(words(outcome) || RUNNING, took(clock, step))].join("; "), rows };
}

const RUNNING = t("picture.running", "running");
/** @param {string} outcome @param {string} time @returns both in one sentence */
const after = (outcome, time) => t("picture.after", "{outcome} after {time}", { outcome, time });

/** @param {number | null} moves */
const needed = (moves) => (moves === null ? "not within the limit" : many(moves, "move"));

/** Return what the expert would do before a move, and how many moves it needs after each action.
 * @param {Answers.Task} about @param {Answers.Advice} advice @param {string} made */
function adviceText({ actions }, { action, needs, cost, after }, made) {
  const choice = `It would choose ${words(action)} and needs ${needed(needs)} from here.`;
  const others = (after ?? []).map((moves, index) => `${words(actions[index])}: ${needed(moves)}`).join("; ");
  const price = made && made !== action ? ` The move made, ${words(made)}, cost ${many(cost, "move")}.` : "";
  return `${choice}${price}${others && ` After ${others}.`}`;
}

/** Return what the moves of an episode cost, in sentences.
 * @param {Answers.Costs} costs */
function costsInWords({ policy, reason, counts, expert_moves: expert, given_up, mistakes }) {
  const whole = expert === null ? "" : t("picture.costs.whole", "Your episode counts {moves}, {policy}'s {expert}. ", { moves: movesText(counts), policy, expert });
  if (reason !== null) return { summary: `${whole}${capital(reason)}.`, mistakes: [], rest: [] };
  const end = given_up ? t("picture.costs.given_up", "Ending without a move cost {moves}. ", { moves: movesText(given_up) }) : "";
  return {
    summary: `${whole}${end}${mistakes.length ? "" : t("picture.costs.none", "No move cost 2 moves or more.")}`.trim(), rest: [],
    mistakes: mistakes.map(({ step, cost, action, expert_action: better }) =>
      t("picture.costs.mistake", "Move {number}, {action}, cost {cost}: {better} was better.", { number: step + 1, action: actionText(action), cost: movesText(cost), better: actionText(better) })),
  };
}

/** @param {Answers.Task} about @returns {TaskOf<Picture.Frame, null, Picture.Course, Picture.History>} */
export function taskOf(about) {
  const metric = about.metrics[0] ?? { name: "return", unit: "", lowest: null, highest: null };
  const ends = [metric.lowest, metric.highest];
  /** @param {Picture.Frame} frame */
  const progress = ({ headline, return: earned }) => headline ?? earned ?? 0;
  /** @param {number} value */
  const shown = (value) => `${tickText(value)}${metric.unit ? ` ${metric.unit}` : ""}`;
  /** @param {Picture.Course} course @param {number} step */
  const frameAt = ({ frames }, step) => {
    let [low, high] = [0, frames.length]; // the last one that is no later is in low..high-1
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (frames[middle].step <= step) low = middle; else high = middle;
    }
    return frames[low];
  };
  /** @param {Picture.Frame} frame */
  const ending = ({ outcome, step }) => ({ title: after(capital(words(outcome)), took(about.clock, step)), line: outcome === "environment_failed" ? FAILED : "" });
  return {
    ...about, nameOf: (policy) => (policy === "random" ? t("policy.random", "Random") : policy), order: reached(about), round: t("picture.round", "round"), target: "the end", standing: "",
    chart: {
      title: metric.name, say: shown,
      axis(_, values) {
        const [low, high] = span([...values, ...ends]) ?? [0, 1];
        return { low, high, ticks: ticks(low, high), text: tickText };
      },
    },
    paint: (place, board, look) => paint(place, board, look, about.clock), inWords: (frame) => inWords(frame, about.clock), progress, ending,
    firstWish: ([policy]) => (policy ? { map: null, seed: null, player: policy.name, rival: policy.name } : null),
    mark: () => null,
    path: ({ headlines = [] }) => ({ trail: headlines.map(() => null), progress: headlines.map((value) => value ?? 0) }),
    shape: () => [1, 1],
    place: () => about.title,
    headline(frame) {
      const [low, high] = [metric.lowest ?? 0, metric.highest ?? 1];
      return { value: tickText(progress(frame)), unit: metric.unit || metric.name, share: Math.min(1, Math.max(0, (progress(frame) - low) / (high - low))) };
    },
    goal: () => about.instructions || about.title,
    outcome: words,
    status: (outcome) => words(outcome) || RUNNING,
    trialEnding(frame) {
      /** @type {[string, string][]} */
      const figures = [about.clock ? [t("picture.time", "Time"), took(about.clock, frame.step)] : [t("play.moves", "Moves"), String(frame.step)], ...(frame.headline === null ? [] : [/** @type {[string, string]} */ ([metric.name, shown(frame.headline)])])];
      return { ...ending(frame), advice: "", figures: frame.score === null ? figures : [...figures, [t("play.score", "Score"), score(frame.score)]] };
    },
    compare(_, theirs, rival) {
      return theirs ? `${rival}: ${words(theirs.outcome) || "running"} after ${took(about.clock, theirs.step)}, ${shown(progress(theirs))}.` : "";
    },
    announcement(before, after) {
      if (before?.episode !== after.episode) return t("picture.new", "New episode of {title}.", { title: about.title });
      return after.outcome && !before.outcome ? `${ending(after).title}.` : after.text ?? "";
    },
    hint: () => null,
    coach: (_, keyOf) => [t("ready.tutorial_go", "Try the keys"), `${about.instructions} ${reached(about).map((action) => `${keyOf(action)}: ${actionText(action)}`).join(", ")}.`.trim()],
    ahead: () => "free",
    allowed: ({ allowed }) => allowed,
    sound: (_, after) => (after.outcome ? { kind: "over" } : null),
    courseOf(name, frames) {
      const end = frames[frames.length - 1];
      return end ? { name, frames, outcome: end.outcome, score: end.score, sentence: ending(end).title, actions: Array(end.step).fill("") } : null;
    },
    boardAt: (course, step) => ({ frame: frameAt(course, step), trail: [] }),
    adviceText: (advice, course, step) => adviceText(about, advice, step === course.actions.length ? "" : course.actions[step]),
    costsInWords: (costs) => costsInWords(costs),
    progressAt: (course, step) => progress(frameAt(course, step)),
  };
}
