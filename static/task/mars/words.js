// MarsExplorer in words, with plain names of policies and levels: forms and addresses keep the technical ones. No document here, so
// that node can test every sentence.
import { axisOfShares } from "../../common/chart_scale.js";
import { plural, t } from "../../common/texts.js";
import { actionText, many, movesText, percent, score, within } from "../../common/words.js";
import { CELL_STATES, cellAfter, linesOf, markAt, WAYS } from "./ground.js";

/** @type {Readonly<Record<string, string>>} */
const POLICIES = Object.freeze({
  ppo: t("mars.policy.ppo", "Expert"), "frontier-cost": t("mars.policy.cost", "Nearest"), "frontier-utility": t("mars.policy.utility", "Greedy"),
  "frontier-priced": t("mars.policy.priced", "Tidy"), lookahead: t("mars.policy.lookahead", "Expert that knows how terrains are made"), random: t("policy.random", "Random"),
});
/** @type {Readonly<Record<string, string>>} */
const LEVELS = Object.freeze({ "1-1-1": "Open", random: "Scattered", "3-2-1": "Boulders", building: "Building", cave: "Cave" });

/** Colour and dash of the policies everybody has, the same on every plot.
 * @type {Readonly<Record<string, [string, string]>>} */
export const lines = Object.freeze({
  ppo: ["--chart-policy", "7 4"], "frontier-priced": ["--line-green", "12 4"], "frontier-utility": ["--line-violet", "2 3"],
  "frontier-cost": ["--line-blue", "9 3 2 3"], lookahead: ["--line-clay", "3 6"], random: ["--line-rose", "4 4"],
});

/** @param {string} policy @returns whether it knows how terrains are made */
export const isInformed = (policy) => policy === "lookahead";

/** @param {string} policy @returns its plain name, or the technical one of a policy that came with somebody's own file */
export const policyName = (policy) => POLICIES[policy] ?? policy;
/** @param {string} level @returns its plain name, or the paper's code */
export const levelName = (level) => LEVELS[level] ?? level;

/** Return the levels as the dialog offers them: those with plain names, then the others under the paper's codes.
 * @param {string[]} levels */
export const levelGroups = (levels) => ({
  plain: Object.keys(LEVELS).filter((level) => levels.includes(level)),
  paper: levels.filter((level) => !(level in LEVELS)),
});

/** @param {string[]} names @returns the policy that a newcomer plays with */
export function favourite(names) {
  return names.find((name) => name.includes("ppo")) ?? names.find((name) => name === "frontier-utility") ?? names.at(-1) ?? "";
}

/** Return what is played until somebody chooses.
 * @param {{name: string}[]} policies @returns {Play.Wish} */
export function firstWish(policies) {
  const names = policies.map(({ name }) => name);
  const rival = favourite(names);
  const player = names.find((name) => name !== rival && name.includes("frontier")) ?? rival;
  return { level: "random", map: null, size: 21, seed: null, rival, player };
}

const TARGET = "99 %";

/** An outcome in a word, as the state of a board, and what the ends of an episode and of a trial say.
 * @type {Record<string, {word: string, status: string, title: string, line: string, trial: [string, string]}>} */
const ENDINGS = {
  explored: { word: "\u2713", status: t("mars.status.explored", "mapped"), title: t("mars.end.explored", "Mapped in {moves}"), line: "99 % of {ground} is on the map.",
    trial: [t("mars.trial.explored", "Terrain mapped"), t("mars.trial.explored_line", "{target} of the terrain is on the map.")] },
  collided: { word: "crashed", status: t("mars.status.collided", "collided"), title: t("mars.end.collided", "Crashed at {coverage} after {moves}"), line: "The rover hit a rock, which ends the episode.",
    trial: [t("mars.trial.collided", "Rover lost: collision"), t("mars.trial.collided_line", "The rover drove into a rock.")] },
  out_of_bounds: { word: "off the map", status: t("mars.status.out_of_bounds", "off the map"), title: t("mars.end.out_of_bounds", "Off the map at {coverage} after {moves}"),
    line: "The rover drove over the edge of the map, which ends the episode.", trial: [t("mars.trial.out_of_bounds", "Rover lost: off the map"), t("mars.trial.out_of_bounds_line", "The rover drove over the edge of the terrain.")] },
  timed_out: { word: "out of moves", status: t("mars.status.timed_out", "out of moves"), title: t("mars.end.timed_out", "Out of moves at {coverage} after {moves}"),
    line: "The last move was made before 99 % of {ground} was on the map.", trial: [t("mars.trial.timed_out", "Out of moves"), t("mars.trial.timed_out_line", "The last move was made before {target} was mapped.")] },
  abandoned: { word: "abandoned", status: t("mars.status.abandoned", "abandoned"), title: t("mars.end.abandoned", "Abandoned at {coverage} after {moves}"), line: "The episode was left before its end.",
    trial: [t("mars.trial.abandoned", "Abandoned"), t("mars.trial.abandoned_line", "The episode was left before its end.")] },
};

/** Return what coverage is a share of: the whole ground, or where walls hide some of it, what the rover can see of it.
 * @param {Pick<Mars.Frame, "rows" | "cols" | "cells">} frame */
const ground = ({ rows, cols, cells }) => (cells < rows * cols ? "what can be seen" : "the ground");

/** @param {Mars.Frame} frame @returns the moves until the goal was reached, or null when it never was */
export const stepsToGoal = ({ outcome: found, step }) => (found === "explored" ? step : null);

/** Return the matrix in words: where the rover stands and what lies next to it.
 * @param {Mars.Frame} frame @param {string} name */
export function describe(frame, name) {
  const { position, rows, cols, coverage, step } = frame;
  const around = Object.keys(WAYS).map((way) => `${actionText(way)} ${stateOf(markAt(linesOf(frame), cellAfter(position, way)))}`);
  return t("mars.matrix", "State matrix of {name}: {rows}, {cols}. Rover at row {row}, column {col}. {around}. {percent} percent mapped in {moves}.", {
    name, rows: plural("mars.rows", rows, "{n} row", "{n} rows"), cols: plural("mars.cols", cols, "{n} column", "{n} columns"),
    row: position[0] + 1, col: position[1] + 1, around: around.join(", "), percent: percent(coverage), moves: movesText(step),
  });
}
/** @param {string | undefined} mark */
const stateOf = (mark) => /** @type {Record<string, string>} */ (CELL_STATES)[mark ?? ""] ?? t("mars.cell.edge", "edge");

/** Return the maximal runs of equal characters: [start, length, character].
 * @param {string} line @returns {[number, number, string][]} */
export const runs = (line) => Array.from(line.matchAll(/(.)\1*/g), ({ index, 0: run, 1: mark }) => [index ?? 0, run.length, mark]);

/** The first moves, each of which says how many cells it uncovered. */
const FIRST_MOVES = 8;

/** @param {Mars.Frame} frame @returns what lies in front of the rover: the grid's character, or "edge" */
export const inFront = (frame) => markAt(linesOf(frame), cellAfter(frame.position, frame.heading)) ?? "edge";

/** The sentences in the order of their weight; the first one that fits and has not been said is said. What the lidar
 * does comes with the first move, or with the one after it where a rock lies ahead.
 * @type {[string, (after: Mars.Frame, gained: number) => boolean, string][]} */
const LINES = [
  ["rock", (after) => inFront(after) === "#", "A rock is right in front of you. Hitting it ends the episode."],
  ["edge", (after) => after.step > 1 && inFront(after) === "edge", "The edge of the map is right in front of you. Driving over it ends the episode."],
  ["first", () => true, "Your lidar uncovers what is in sight."],
  ["rocks", (after) => linesOf(after).some((line) => line.includes("#")), "There are rocks on the map. Drive round them."],
  ["nothing", (_after, gained) => gained === 0, "Nothing new there. Head for what is unknown."],
  ["quarter", ({ coverage }) => coverage >= 0.25 && coverage < 0.5, "A quarter of the ground is on the map. Rocks hide what is behind them."],
  ["half", ({ coverage }) => coverage >= 0.5 && coverage < 0.9, "Half of the ground. Plan a way that passes each unknown patch once."],
  ["most", ({ coverage }) => coverage >= 0.9, "Nearly there. The last unknown cells hide behind rocks and in corners."],
];

/** Return who did better, where both have ended; "" where the player's own end says more.
 * @param {Mars.Frame} mine @param {Mars.Frame} theirs @param {string} rival @param {string | null} watched */
function verdictOf(mine, theirs, rival, watched) {
  const [a, b] = [stepsToGoal(mine), stepsToGoal(theirs)];
  const other = within(rival);
  if (a !== null && b !== null) {
    const gap = many(Math.abs(a - b), "move");
    if (watched !== null) return a === b ? `Both needed ${many(a, "move")}` : `${a < b ? watched : rival} won by ${gap}`;
    return a === b ? `Level with ${other}` : `${gap} ${a < b ? "ahead of" : "behind"} ${other}`;
  }
  if (watched === null) return "";
  if (a === null && b === null) return `Neither mapped ${TARGET}`;
  return a === null ? `${rival} won: ${watched} ${words.status(mine.outcome)}` : `${watched} won: ${rival} ${words.status(theirs.outcome)}`;
}

/** @type {Mars.Words} */
export const words = {
  round: t("mars.round", "terrain"), target: TARGET,
  chart: { title: t("mars.mapped", "Mapped"), goal: { at: 0.99, text: TARGET }, axis: axisOfShares, say: (share) => t("mars.percent", "{n} percent", { n: Math.floor(100 * share + 1e-9) }) },
  shareText: (share) => `${percent(share)} % mapped`,
  tries: { title: "Would you drive another way?", note: "Each board stands where your longest stretch without anything new began. To try is practice: nothing counts." },
  standing: "Your lidar uncovers what is in sight. Rocks and the edge of the map end the episode.",
  beside: (rival) => `${rival} drives the same terrain beside you: fewer moves win.`,
  outcome: (found) => (found ? ENDINGS[found]?.word ?? found : ""),
  status: (found) => (found ? ENDINGS[found]?.status ?? found : t("mars.status.exploring", "exploring")),
  goal: (frame) => `Map ${TARGET} of ${frame ? ground(frame) : "the ground"} in as few moves as you can`,
  place: (level, { rows, cols }) => `${levelName(level)} \u00b7 ${rows} \u00d7 ${cols}`,
  headline: ({ coverage }) => ({ value: percent(coverage), unit: "% mapped", share: coverage }),
  ending(frame) {
    const { title, line } = ENDINGS[frame.outcome ?? ""] ?? { title: "{coverage} after {moves}", line: "" };
    return { title: title.replace("{coverage}", `${percent(frame.coverage)} %`).replace("{moves}", movesText(frame.step)), line: line.replace("{ground}", ground(frame)) };
  },
  trialEnding({ outcome: found, step, coverage, score: value }, wanted) {
    const [title, line] = ENDINGS[found ?? ""]?.trial ?? [found ?? "", ""];
    const isLost = found === "collided" || found === "out_of_bounds";
    const lost = isLost ? t("mars.trial.lost", "In the study that would have ended this terrain. Try once more, or go on.") : "";
    const advice = found === "explored" ? t("mars.trial.all", "That is all there is to it.") : lost;
    /** @type {[string, string][]} */
    const figures = [[t("play.moves", "Moves"), String(step)], [t("mars.mapped", "Mapped"), `${percent(coverage)} %`]];
    return { title, line: line.replace("{target}", wanted), advice, figures: value === null ? figures : [...figures, [t("play.score", "Score"), score(value)]] };
  },
  verdict(mine, theirs, rival, watched) {
    const title = theirs?.outcome ? verdictOf(mine, theirs, rival, watched) : "";
    const needed = stepsToGoal(mine);
    if (!title) return null;
    const other = theirs && stepsToGoal(theirs);
    const both = other === null || other === needed ? "" : `, ${rival} ${other}`;
    return { title, line: needed === null ? `${words.ending(mine).title}.` : `${watched ?? "You"} needed ${many(needed, "move")}${both}.` };
  },
  compare(mine, theirs, rival) {
    if (!theirs) return "";
    if (theirs.outcome === null) return `${rival} is still exploring: ${many(theirs.step, "move")}, ${percent(theirs.coverage)} % so far.`;
    const [a, b] = [stepsToGoal(mine), stepsToGoal(theirs)];
    if (a === null && b !== null) return `${rival} reached ${TARGET} in ${many(b, "move")}.`;
    if (a === null || b === null) return `${rival} did not reach ${TARGET}${a === null ? " here either" : ""}: ${words.status(theirs.outcome)} after ${many(theirs.step, "move")}.`;
    return ""; // the verdict has both
  },
  inWords(frame, name) {
    const rows = linesOf(frame).map((line) => runs(line).map(([, length, mark]) =>
      (mark === "@" ? stateOf(mark) : `${length} ${mark === "#" ? t("mars.cell.rock", "rock") : stateOf(mark)}`)).join(", "));
    return { line: describe(frame, name), rows };
  },
  /** Each tenth of the ground, and the end. */
  announcement(before, after) {
    if (!before || before.episode !== after.episode) return t("mars.said.new", "New terrain, {rows} by {cols}. {percent} percent in sight.", { rows: after.rows, cols: after.cols, percent: percent(after.coverage) });
    if (after.outcome && !before.outcome) {
      const end = `${words.ending(after).title.replace("%", t("mars.percent_word", "percent"))}.`;
      return after.score === null ? end : `${end} ${t("mars.said.score", "Score {score}.", { score: score(after.score) })}`;
    }
    const tenth = Math.floor(after.coverage * 10);
    return tenth > Math.floor(before.coverage * 10) ? t("mars.said.tenth", "{percent} percent mapped in {moves}.", { percent: tenth * 10, moves: movesText(after.step) }) : "";
  },
  sound(before, after) {
    const ends = { explored: "finish", collided: "crash", out_of_bounds: "crash" };
    if (after.outcome) return { kind: /** @type {"finish"} */ (/** @type {Record<string, string>} */ (ends)[after.outcome] ?? "over") };
    const count = after.discovered - before.discovered;
    return count > 0 ? { kind: "gain", count } : null;
  },
  hint(before, after, said) {
    const gained = after.discovered - before.discovered;
    const gain = gained > 0 && after.step <= FIRST_MOVES ? `+${many(gained, "new cell")}` : "";
    const [id, , line] = LINES.find(([name, fits]) => !said.has(name) && fits(after, gained)) ?? ["", null, ""];
    return gain || line ? { id, gain, line } : null;
  },
  coach({ step, coverage }, keyOf, wanted) {
    if (step === 0) return [t("mars.coach.first", "Make the first move"), t("mars.coach.first_line", "You are the bright cell in the top left corner. Drive one cell with {east} or {south}.", { east: keyOf("east"), south: keyOf("south") })];
    if (step < 4) return [t("mars.coach.lidar", "Your lidar maps as you drive"), t("mars.coach.lidar_line", "Each move shows what is in line of sight around the rover. Plain cells are still unknown, brown ones are free ground.")];
    if (step < 9) return [t("mars.coach.rocks", "Keep clear of rocks and edges"), t("mars.coach.rocks_line", "Pale cells are rocks. Driving into one, or over the edge of the map, loses the rover and ends the terrain.")];
    if (coverage < 0.5) return [t("mars.coach.unknown", "Look for what is unknown"), t("mars.coach.unknown_line", "Steer to where much is unknown. Rocks cast shadows: look behind them as well.")];
    if (coverage < 0.9) return [t("mars.coach.half", "More than half is mapped"), t("mars.coach.half_line", "Few moves are what counts, so plan a way that passes each black patch once.")];
    return [t("mars.coach.nearly", "Nearly there"), t("mars.coach.nearly_line", "The terrain is done at {target}. The last unknown cells are often behind rocks and in corners.", { target: wanted })];
  },
};
