// The sentences of a player's own page; no document here, so that node can test every one.
import { many, signed } from "../common/words.js";
import { attemptText, streakText } from "../daily/words.js";
import { choicesOn, streak } from "../puzzles/words.js";

/** @param {Task} task @param {Answers.OwnHistory} history @returns the sentence below the heading */
export function summary({ target, round }, { total, bests }) {
  if (!total) return "Your bests, your place among people and every episode stand here once one has ended.";
  const successes = bests.reduce((sum, { successes: count }) => sum + count, 0);
  return `You have played ${many(total, "episode")} in this browser, and came to ${target} in ${successes ? many(successes, round) : `no ${round}`}.`;
}

/** Episodes that the newest one is measured by. */
const LAST = 10;

/** Return how an episode that has just ended stands among the player's own on terrains like it, "" where nothing is to be said.
 * @param {Pick<Task, "successes" | "round">} task @param {Answers.OwnHistory} history whose newest episode it is
 * @param {string} episode */
export function personalText({ successes, round }, { episodes, bests }, episode) {
  const own = episodes.find((each) => each.episode === episode);
  if (!own || !successes.includes(own.outcome)) return "";
  const isAlike = (/** @type {{place: string}} */ { place }) => place === own.place;
  const before = episodes.filter((each) => each !== own && each.ended_ms <= own.ended_ms && successes.includes(each.outcome) && isAlike(each)).slice(0, LAST);
  const best = bests.find(isAlike)?.best;
  if (best?.episode === episode) return before.length ? "Your best so far." : "";
  const mean = before.reduce((sum, { moves }) => sum + moves, 0) / before.length;
  const better = before.length === LAST && own.moves < mean ? `Better than your last ten, which took ${mean.toFixed(1)} moves on average.` : "";
  const why = best && own.moves < best.moves ? `This one is no best: its ${round} was chosen or met before, or a script has moved.` : "";
  const record = best ? `Your best on a ${round} that was new to you is ${many(best.moves, "move")}.` : "";
  return [better, record, why].filter(Boolean).join(" ");
}

/** Return what a ranked episode that has just ended is worth among people, "" where it is not of their board's terrains.
 * @param {Pick<Task, "successes" | "round" | "nameOf" | "expert">} task @param {Pick<Answers.OwnHistory, "episodes">} history
 * @param {string} episode @param {Pick<Answers.People, "title" | "most_behind" | "you">} people */
export function rankedText({ successes, round, nameOf, expert }, { episodes }, episode, { title, most_behind: most, you }) {
  const own = episodes.find((each) => each.episode === episode);
  if (own?.kind !== "ranked" || !own.counts || own.place !== title) return "";
  const name = nameOf(expert ?? "");
  const lost = isFinished({ successes }, own) ? "" : `On the leaderboard this ${round} counts ${many(most, "move")} behind ${name}, if ${name} finishes it.`;
  // those that have just ended count as soon as the expert has driven on them
  const missing = (you?.missing ?? 0) - (you?.comparing ?? 0);
  const wait = you?.missing ? `You have a place among people once ${name} has finished your ${round}s.` : "";
  const left = missing > 0 ? `${many(missing, `more ranked ${round}`)}, and you have a place among people.` : wait;
  return [lost, left].filter(Boolean).join(" ");
}

/** @param {Pick<Task, "successes">} task @param {Pick<Answers.OwnEpisode, "outcome" | "counts" | "not_attested">} episode
 * @returns whether it succeeded, and did not count as abandoned because of a move without a key or touch */
export const isFinished = ({ successes }, { outcome, counts, not_attested: reason }) => successes.includes(outcome) && !(counts && reason);

/** @param {Pick<Task, "round">} task @param {Answers.OwnEpisode} episode
 * @returns what an episode was, and why a ranked one does not count, "" where nothing is to be said */
export function kindText({ round }, { kind, day, counts, not_attested: reason, met_before: isKnown }) {
  if (kind === "daily") return ["daily", reason ? `Does not count: ${reason}` : `The daily terrain of ${day}`];
  if (kind === "practice" || counts) return [kind, ""];
  const why = reason ?? (isKnown ? `you had met its ${round} before` : "");
  return ["ranked, does not count", why && `Does not count: ${why}`];
}

/** @param {Pick<Task, "round">} task @param {Answers.Best} best
 * @returns where a player's ranked episodes stand among the volunteers' */
export function standingText({ round }, { people: { means, you, ranked, missing } }) {
  if (you === null) {
    const own = `${ranked ? `You have ${many(ranked, "ranked episode")} that ${ranked === 1 ? "counts" : "count"}` : "You have none here that counts yet"}`;
    return `A mean and a place need ${many(ranked + missing, "ranked episode")}. ${own}: ${missing} ${missing === 1 ? "is" : "are"} missing. `
      + (means.length ? `${many(means.length, "person", "people")} ${means.length === 1 ? "has" : "have"} so many.` : "Nobody has so many yet.");
  }
  const mean = `You need ${you.toFixed(1)} moves on average, over ${many(ranked, "ranked episode")}`;
  if (means.length < 2) return `${mean}. You are the only person with so many so far.`;
  const better = means.filter((each) => each < you).length;
  return `${mean}: place ${better + 1} of ${many(means.length, "person", "people")}. A ${round} that was not finished counts the limit.`;
}

/** @param {Task} task @param {Answers.Best} best */
export function bestText({ target }, { best, episodes, successes }) {
  if (!best) return `None came to ${target} yet, of ${many(episodes, "episode")}.`;
  return `${successes} of ${many(episodes, "episode")} came to ${target}.`;
}

/** @param {Pick<Task, "expert" | "nameOf" | "round">} task @param {Me.Gap[]} gaps the oldest episode first
 * @returns the curve in words */
export function gapsText(task, gaps) {
  const expert = task.nameOf(task.expert ?? "");
  if (!gaps.length) return `No ranked ${task.round} yet. Each one of the kind that the leaderboard has is compared with ${expert}'s own run on it.`;
  const mean = (/** @type {number[]} */ moves) => moves.reduce((sum, each) => sum + each, 0) / moves.length;
  const more = gaps.filter(({ isFinished }) => isFinished).map(({ gap }) => gap);
  const open = gaps.length - more.length;
  const unfinished = open ? ` ${many(open, "episode")} ${open === 1 ? "was" : "were"} not finished (${open === 1 ? "a cross" : "crosses"}).` : "";
  if (!more.length) return unfinished.trim();
  const gap = mean(more);
  const half = Math.floor(more.length / 2);
  const over = half === 1 ? "in the" : "over the";
  const ofThem = half === 1 ? "" : ` ${half}`;
  const change = half ? ` ${signed(mean(more.slice(0, half)))} ${over} first${ofThem}, ${signed(mean(more.slice(-half)))} ${over} last${ofThem}.` : "";
  const isEqual = Math.abs(gap) < 0.05;
  const needed = isEqual ? `as many moves as ${expert}` : `${Math.abs(gap).toFixed(1)} moves ${gap < 0 ? "fewer" : "more"} than ${expert}`;
  return `You needed ${needed} ${more.length === 1 ? "in" : "on average, over"} ${many(more.length, "finished episode")}.${change}${unfinished}`;
}

/** @param {string} state @param {number} days @returns {string} */
const withStreak = (state, days) => [state, streakText(days)].filter(Boolean).join(", ");

/** @param {Task} task @param {Pick<Answers.Today, "attempt" | "streak">} today @returns {string} how the daily terrain stands */
export const dailyText = (task, { attempt, streak: days }) => withStreak(`${attemptText(task, attempt)} today`, days);

/** @param {Pick<Answers.Puzzles, "day" | "puzzles">} today @param {Puzzles.Answered} answered @returns {string} how today's puzzles stand */
export function puzzlesText({ day, puzzles }, answered) {
  const done = choicesOn(answered, day).length;
  const state = done ? `${done} of ${puzzles.length} answered today` : "not answered today";
  return withStreak(state, streak(answered, day, puzzles.length));
}

/** Find the longest stretch without anything new that a move with something new ended.
 * @param {number[]} progress 0..1 before the first move and after each @returns {Me.Idle} after how many moves it begins */
export function idleIn(progress) {
  let longest = { after: 0, moves: 0 }, after = 0;
  progress.forEach((share, step) => {
    if (share === progress[after]) return;
    if (step - 1 - after > longest.moves) longest = { after, moves: step - 1 - after };
    after = step;
  });
  return longest;
}

/** @param {Me.Idle} idle @returns {string} what stands below a position to try from */
export const idleText = ({ after, moves }) => `after ${many(after, "move")}: then ${moves} showed nothing new`;
