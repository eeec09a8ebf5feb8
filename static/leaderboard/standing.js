// From the server's answer to what stands on the page: order, scale, sentences. No document here.
import { roundUp } from "../common/chart_scale.js";
import { many } from "../common/words.js";

/** Colour (a custom property of base.css) and dash of policies for which the task has none, in turn.
 * @type {[string, string][]} */
const REST = [["--line-olive", "10 2 2 2"], ["--line-stone", "1 4"]];
const PEOPLE_COLOUR = "--chart-you";

/** @param {number} value @param {Leaderboard.Measure} measure */
export const shown = (value, measure) => (measure === "steps" ? value.toFixed(1) : value.toFixed(3).replace("-", "\u2212"));
/** @param {Answers.Interval} value @param {Leaderboard.Measure} measure */
export const intervalText = (value, measure) => (value.low === null || value.high === null ? "\u2013" : `${shown(value.low, measure)} to ${shown(value.high, measure)}`);

/** Return what a board's people are called: those of a study are its participants, those of the playground volunteers.
 * @param {Answers.LeaderboardEntry} board */
const peopleName = ({ study }) => (study ? "People" : "Volunteers");

/** Return everyone on the board, the best first; those still without a figure last.
 * @param {Pick<Task, "lines">} task @param {Answers.Leaderboard} detail @param {Leaderboard.Measure} measure
 * @returns {Leaderboard.Row[]} */
export function rows({ lines = {} }, { board, people, policies }, measure) {
  const others = policies.filter(({ name }) => !lines[name]);
  /** @type {Leaderboard.Row[]} */
  const found = policies.map((policy) => {
    const [colour, dash] = lines[policy.name] ?? REST[others.indexOf(policy) % REST.length];
    return { who: "policy", name: policy.name, colour, dash, figure: policy.figure, policy };
  });
  if (people) found.unshift({ who: "people", name: peopleName(board), colour: PEOPLE_COLOUR, dash: "", figure: people, policy: null });
  const rank = (/** @type {Leaderboard.Row} */ { figure }) => (figure ? (measure === "steps" ? 1 : -1) * figure[measure].mean : Infinity);
  return found.sort((a, b) => (rank(a) === rank(b) ? 0 : rank(a) - rank(b)));
}

/** Return where the axis of coverage ends: when the last of those who finish has 98.5 % on the map.
 * @param {Answers.CoverageCurve[]} curves */
export function coverageEnd(curves) {
  const ends = curves.flatMap(({ steps, mean }) => {
    const at = mean.findIndex((share) => share >= 0.985);
    return at < 0 ? [] : [steps[at]];
  });
  const longest = Math.max(20, ...(ends.length ? ends : curves.map(({ steps }) => steps[steps.length - 1])));
  return roundUp(longest * 1.06, longest);
}

/** Return the moves until a curve's mean first reaches a share, or null.
 * @param {Answers.CoverageCurve} curve @param {number} share */
function movesTo({ steps, mean }, share) {
  const at = mean.findIndex((each) => each >= share);
  return at < 0 ? null : steps[at];
}

/** @param {Answers.LeaderboardEntry} board @returns why the volunteers have no mean */
export function missingText({ players, episodes, missing }) {
  if (!players || !missing) return "nobody has played this ranked yet.";
  const lacks = `${missing.players} ${missing.players === 1 ? "is" : "are"} missing`;
  return `${many(players, "player")} and ${many(episodes, "ranked episode")} so far, and no mean yet. `
    + `It needs ${many(missing.of, "player")} with ${many(missing.episodes, "ranked episode")} each: ${lacks}.`;
}

/** @param {Answers.LeaderboardPeople} people who are behind a mean @param {Answers.LeaderboardEntry} board */
function peopleText({ players, episodes, abandoned }, board) {
  const others = board.study ? 0 : board.players - players;
  const less = others ? `; ${many(others, "player")} with fewer episodes ${others === 1 ? "is" : "are"} not in it` : "";
  return `${many(players, "player")} and ${many(episodes, "episode")}${abandoned ? `, ${abandoned} of them abandoned` : ""}${less}`;
}

/** @param {Task} task @param {Answers.Leaderboard} detail @returns the sentence under the heading */
export function headline({ target, round, nameOf, isInformed }, { board, people, policies }) {
  const fair = policies.filter(({ name }) => !isInformed?.(name));
  const ready = fair.filter(({ figure }) => figure).sort((a, b) => (a.figure?.steps.mean ?? 0) - (b.figure?.steps.mean ?? 0));
  const best = ready.length === fair.length ? ready[0] : undefined;
  const which = fair.length < policies.length ? `The best policy that does not know how ${round}s are made` : "The best policy";
  const policy = best?.figure ? ` ${which}, ${nameOf(best.name)}, takes ${shown(best.figure.steps.mean, "steps")} moves on average.` : "";
  const terrain = board.place;
  if (!people) {
    if (board.study) return `No person finished the study ${board.study}, so it has no human score.${policy}`;
    return `Volunteers on this playground, ${terrain}: ${missingText(board)}${policy}`;
  }
  const spread = people.steps.low === null ? `no interval: ${people.players < 5 ? "fewer than five players" : "these players do not differ"}` : `95 % interval ${intervalText(people.steps, "steps")}`;
  const who = board.study ? `${people.claim} in the study ${board.study}` : "Volunteers on this playground";
  const from = peopleText(people, board);
  const { everybody } = people;
  const began = everybody?.steps && people.set !== "everybody" ? ` Everybody who began (${many(everybody.players, "player")}): ${shown(everybody.steps.mean, "steps")} moves.` : "";
  return `${who}, ${terrain}: ${shown(people.steps.mean, "steps")} moves to ${target} (${spread}), from ${from}.${began}${policy}`;
}

/** @param {Task} task @param {Answers.Leaderboard} detail
 * @returns {[string, string]} who people are here, and what policies play */
export function reading({ round }, { board, people }) {
  if (!board.study) {
    return ["Volunteers chose to play ranked on the page, and how often: they stand for nobody but themselves, and their figure is no human level. What they played was neither chosen nor met before, no policy beside them; an episode that was left counts as abandoned. A mean is over those with at least five ranked episodes and needs five of them; each weighs once, so the interval is over players.",
      `Policies play ${many(board.terrains, `fixed ${round}`)} of the same kind, kept from all training; their interval is over ${round}s. In a closed study both play the very same ones.`];
  }
  const set = people?.set === "everybody" ? " who began a ranked episode" : " who finished as its protocol asks";
  return [`People are the participants of this closed study${set}; each weighs once, and the interval is the one of its report. Curves and visits are over the ranked episodes of everybody who took part; scripts never enter.`,
    `Policies play exactly the study's ${many(board.terrains, `ranked ${round}`)}; their interval is over ${round}s. The report compares them pair by pair.`];
}

/** Return what stands under the ranks: the line of the people where it is drawn, the break of the axis where there is
 * one, and the origin of the policies' figures that came with the package.
 * @param {Task} task @param {Answers.Leaderboard} detail @param {boolean} isBroken */
export function ranksNote({ title, nameOf }, { board, people, policies }, isBroken) {
  const parts = people ? [`The dashed line is the mean of ${board.study ? "the study's people" : "the volunteers"}.`] : [];
  if (isBroken) parts.push("The axis is broken at the hatched strip: who stands beyond it is far off.");
  const came = policies.filter(({ shipped }) => shipped);
  if (came.length) {
    const whose = came.length === policies.length ? "The policies' figures" : `The figures of ${came.map(({ name }) => nameOf(name)).join(", ")}`;
    parts.push(`${whose} come with ${title}.`);
  }
  return parts.join(" ");
}

/** @param {Task} task @param {Leaderboard.Row} row @returns where a figure comes from */
export function source({ round }, { who, figure }) {
  if (!figure) return "";
  return who === "people" ? `${many(/** @type {Answers.LeaderboardPeople} */ (figure).players, "player")}, ${many(figure.episodes, "episode")}` : many(figure.episodes, round);
}

/** Return what is still being made, or null.
 * @param {Task} task @param {Answers.LeaderboardPolicy[]} policies
 * @returns {{text: string, done: number, of: number} | null} */
export function working({ round, nameOf }, policies) {
  const open = policies.filter(({ state }) => state === "waiting" || state === "computing");
  if (open.length === 0) return null;
  const now = open.find(({ state }) => state === "computing");
  const done = policies.reduce((sum, each) => sum + (each.state === "failed" ? each.of : each.done), 0);
  const of = policies.reduce((sum, each) => sum + each.of, 0);
  const what = now ? `${nameOf(now.name)} plays ${round} ${Math.min(now.done + 1, now.of)} of ${now.of}` : "about to start";
  return { text: `Evaluating ${many(open.length, "policy", "policies")}: ${what}. The figures appear here as they are done.`, done, of };
}

/** @param {string} name @param {Answers.CoverageCurve} curve @returns a coverage curve in words */
export function curveText(name, curve) {
  const at = [0.5, 0.9].map((share) => [share, movesTo(curve, share)]).filter(([, moves]) => moves !== null);
  const last = curve.mean[curve.mean.length - 1];
  return `${name}: ${at.map(([share, moves]) => `${Math.round(100 * Number(share))} percent after ${many(Number(moves), "move")}`).join(", ")}; ${(100 * last).toFixed(1)} percent in the end`;
}
