// MarsExplorer in words, with plain names of policies and levels: forms and addresses keep the technical ones. No document here, so
// that node can test every sentence.
import { axisOfShares } from "../../common/chart_scale.js";
import { many, percent, score, within } from "../../common/words.js";
import { CELL_STATES, cellAfter, linesOf, markAt, WAYS } from "./ground.js";

/** @type {Readonly<Record<string, string>>} */
const POLICIES = Object.freeze({
  ppo: "Expert", "frontier-cost": "Nearest", "frontier-utility": "Greedy", "frontier-priced": "Tidy",
  lookahead: "Expert that knows how terrains are made", random: "Random",
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
  explored: { word: "mapped", status: "mapped", title: "Mapped in {moves}", line: "99 % of {ground} is on the map.",
    trial: ["Terrain mapped", "{target} of the terrain is on the map."] },
  collided: { word: "crashed", status: "collided", title: "Crashed at {coverage} after {moves}", line: "The rover hit a rock, which ends the episode.",
    trial: ["Rover lost: collision", "The rover drove into a rock."] },
  out_of_bounds: { word: "off the map", status: "off the map", title: "Off the map at {coverage} after {moves}",
    line: "The rover drove over the edge of the map, which ends the episode.", trial: ["Rover lost: off the map", "The rover drove over the edge of the terrain."] },
  timed_out: { word: "out of moves", status: "out of moves", title: "Out of moves at {coverage} after {moves}",
    line: "The last move was made before 99 % of {ground} was on the map.", trial: ["Out of moves", "The last move was made before {target} was mapped."] },
  abandoned: { word: "abandoned", status: "abandoned", title: "Abandoned at {coverage} after {moves}", line: "The episode was left before its end.",
    trial: ["Abandoned", "The episode was left before its end."] },
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
  const around = Object.keys(WAYS).map((way) => `${way} ${stateOf(markAt(linesOf(frame), cellAfter(position, way)))}`);
  return `State matrix of ${name}: ${many(rows, "row")}, ${many(cols, "column")}. Rover at row ${position[0] + 1}, column ${position[1] + 1}. `
    + `${around.join(", ")}. ${percent(coverage)} percent mapped in ${many(step, "move")}.`;
}
/** @param {string | undefined} mark */
const stateOf = (mark) => /** @type {Record<string, string>} */ (CELL_STATES)[mark ?? ""] ?? "edge";

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
  ["rocks", (after) => linesOf(after).some((line) => line.includes("#")), "Pale blocks are rocks. Drive round them."],
  ["nothing", (_after, gained) => gained === 0, "Nothing new there. Head for the dark."],
  ["quarter", ({ coverage }) => coverage >= 0.25 && coverage < 0.5, "A quarter of the ground is on the map. Rocks hide what is behind them."],
  ["half", ({ coverage }) => coverage >= 0.5 && coverage < 0.9, "Half of the ground. Plan a way that passes each dark patch once."],
  ["most", ({ coverage }) => coverage >= 0.9, "Nearly there. The last dark cells hide behind rocks and in corners."],
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
  round: "terrain", target: TARGET,
  chart: { title: "Mapped", goal: { at: 0.99, text: TARGET }, axis: axisOfShares, say: (share) => `${Math.floor(100 * share + 1e-9)} percent` },
  shareText: (share) => `${percent(share)} % mapped`,
  tries: { title: "Would you drive another way?", note: "Each board stands where your longest stretch without anything new began. To try is practice: nothing counts." },
  standing: "Your lidar uncovers what is in sight. Rocks and the edge of the map end the episode.",
  outcome: (found) => (found ? ENDINGS[found]?.word ?? found : ""),
  status: (found) => (found ? ENDINGS[found]?.status ?? found : "exploring"),
  goal: (frame) => `Map ${TARGET} of ${frame ? ground(frame) : "the ground"} in as few moves as you can`,
  place: (level, { rows, cols }) => `${levelName(level)} \u00b7 ${rows} \u00d7 ${cols}`,
  headline: ({ coverage }) => ({ value: percent(coverage), unit: "% mapped", share: coverage }),
  ending(frame) {
    const { title, line } = ENDINGS[frame.outcome ?? ""] ?? { title: "{coverage} after {moves}", line: "" };
    return { title: title.replace("{coverage}", `${percent(frame.coverage)} %`).replace("{moves}", many(frame.step, "move")), line: line.replace("{ground}", ground(frame)) };
  },
  trialEnding({ outcome: found, step, coverage, score: value }, wanted) {
    const [title, line] = ENDINGS[found ?? ""]?.trial ?? [found ?? "", ""];
    const isLost = found === "collided" || found === "out_of_bounds";
    const advice = found === "explored" ? "That is all there is to it." : isLost ? "In the study that would have ended this terrain. Try once more, or go on." : "";
    /** @type {[string, string][]} */
    const figures = [["Moves", String(step)], ["Mapped", `${percent(coverage)} %`]];
    return { title, line: line.replace("{target}", wanted), advice, figures: value === null ? figures : [...figures, ["Score", score(value)]] };
  },
  verdict(mine, theirs, rival, watched) {
    const title = theirs?.outcome ? verdictOf(mine, theirs, rival, watched) : "";
    const needed = stepsToGoal(mine);
    return title ? { title, line: needed === null ? `${words.ending(mine).title}.` : `${watched ?? "You"} needed ${many(needed, "move")}.` } : null;
  },
  compare(mine, theirs, rival) {
    if (!theirs) return "";
    if (theirs.outcome === null) return `${rival} is still exploring: ${many(theirs.step, "move")}, ${percent(theirs.coverage)} % so far.`;
    const [a, b] = [stepsToGoal(mine), stepsToGoal(theirs)];
    if (a === null && b !== null) return `${rival} reached ${TARGET} in ${many(b, "move")}.`;
    if (a === null || b === null) return `${rival} did not reach ${TARGET}${a === null ? " here either" : ""}: ${words.status(theirs.outcome)} after ${many(theirs.step, "move")}.`;
    return a === b ? "" : `${rival} needed ${many(b, "move")}.`; // the headline has the rest
  },
  inWords(frame, name) {
    const rows = linesOf(frame).map((line) => runs(line).map(([, length, mark]) =>
      (mark === "@" ? stateOf(mark) : `${length} ${mark === "#" ? "rock" : stateOf(mark)}`)).join(", "));
    return { line: describe(frame, name), rows };
  },
  /** Each tenth of the ground, and the end. */
  announcement(before, after) {
    if (!before || before.episode !== after.episode) return `New terrain, ${after.rows} by ${after.cols}. ${percent(after.coverage)} percent in sight.`;
    if (after.outcome && !before.outcome) {
      return `${words.ending(after).title.replace("%", "percent")}.${after.score === null ? "" : ` Score ${score(after.score)}.`}`;
    }
    const tenth = Math.floor(after.coverage * 10);
    return tenth > Math.floor(before.coverage * 10) ? `${tenth * 10} percent mapped in ${many(after.step, "move")}.` : "";
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
    if (step === 0) return ["Make the first move", `You are the bright cell in the top left corner. Drive one cell with ${keyOf("east")} or ${keyOf("south")}.`];
    if (step < 4) return ["Your lidar maps as you drive", "Each move shows what is in line of sight around the rover. Plain cells are still unknown, brown ones are free ground."];
    if (step < 9) return ["Keep clear of rocks and edges", "Pale cells are rocks. Driving into one, or over the edge of the map, loses the rover and ends the terrain."];
    if (coverage < 0.5) return ["Look for what is unknown", "Steer to where much is unknown. Rocks cast shadows: look behind them as well."];
    if (coverage < 0.9) return ["More than half is mapped", "Few moves are what counts, so plan a way that passes each black patch once."];
    return ["Nearly there", `The terrain is done at ${wanted}. The last unknown cells are often behind rocks and in corners.`];
  },
};
