// The sentences of the daily page; no document here, so that node can test every one.
import { many } from "../common/words.js";

/** @param {number} left_ms @returns how long it is until a time, as hours, minutes and seconds */
export function countdown(left_ms) {
  const seconds = Math.max(0, Math.ceil(left_ms / 1000));
  const two = (/** @type {number} */ value) => String(value).padStart(2, "0");
  return `${Math.floor(seconds / 3600)}:${two(Math.floor(seconds / 60) % 60)}:${two(seconds % 60)}`;
}

/** @param {Pick<Task, "round">} task @param {number} left_ms */
export const untilText = ({ round }, left_ms) => `next ${round} in ${countdown(left_ms)}`;

/** @param {string} day "2026-11-22" @returns a day in words: "22 November 2026" */
export function dayText(day) {
  return new Date(`${day}T00:00:00Z`).toLocaleDateString("en-GB", { day: "numeric", month: "long", year: "numeric", timeZone: "UTC" });
}

/** @param {number} days in a row */
export const streakText = (days) => (days > 1 ? `${days} days in a row` : "");

/** @param {Pick<Task, "successes">} task @param {Answers.Today["attempt"]} attempt @returns {string} how an attempt stands */
export function attemptText({ successes }, attempt) {
  if (!attempt) return "not played";
  if (attempt.state === "open") return "begun";
  return successes.includes(attempt.outcome ?? "") ? many(attempt.moves, "move") : "played";
}

/** Return how today stands, for a link to the daily page.
 * @param {Task} task @param {Pick<Answers.Today, "attempt" | "players" | "streak">} today */
export function pillText(task, { attempt, players, streak }) {
  return [attemptText(task, attempt), many(players, "person", "people"), ...(streak > 1 ? [`streak ${streak}`] : [])].join(" \u00b7 ");
}

/** Return a day of the calendar: what stands in it, and in words.
 * @param {Task} task @param {Answers.CalendarDay} past */
export function pastText(task, { day, outcome, moves }) {
  const result = moves === null ? outcome === "abandoned" ? "left" : task.outcome(outcome) || "ended" : many(moves, "move");
  return { short: moves === null ? "\u2715" : String(moves), long: `${dayText(day)}: ${result}` };
}

/** Return what an attempt came to, in a few words.
 * @param {Task} task
 * @param {{outcome: string | null, moves: number | null, coverage: number | null}} attempt with the moves that are known */
export function resultText(task, { outcome, moves, coverage }) {
  const share = coverage === null ? null : task.shareText?.(coverage);
  const made = moves === null ? null : many(moves, "move");
  if (task.successes.includes(outcome ?? "")) return [made, share].filter(Boolean).join(", ");
  const how = outcome === "abandoned" ? "left" : task.outcome(outcome) || "ended";
  return [how, share && `with ${share}`, made && `after ${made}`].filter(Boolean).join(" ");
}

const BARS = "\u2581\u2582\u2583\u2584\u2585\u2586\u2587\u2588";

/** Return a course as a line of symbols: how much was mapped after each eighth of the moves, and nothing of where.
 * @param {number[]} progress 0..1 after each move */
export const symbols = (progress) => progress.length < 2 ? "" : Array.from({ length: 8 }, (_, at) => {
  const share = Math.max(0, progress[Math.round((at + 1) / 8 * (progress.length - 1))]);
  return BARS[Math.min(BARS.length - 1, Math.floor(share * BARS.length))];
}).join("");

/** Return the text to share: it tells nothing of the terrain.
 * @param {Task} task @param {string} day @param {Answers.Attempt} attempt @param {Answers.PolicyOfDay[]} policies
 * @param {string} link @param {number[]} [progress] of the attempt @param {number} [days] in a row */
export function shareText(task, day, attempt, policies, link, progress = [], days = 0) {
  const policy = policies.find(({ name, moves }) => name === task.expert && moves !== null);
  const line = [symbols(progress), streakText(days)].filter(Boolean).join(" ");
  const compared = policy ? `, ${task.nameOf(policy.name)} needed ${policy.moves}` : "";
  return `${task.title} daily ${day}: ${resultText(task, attempt)}${compared}\n${line && `${line}\n`}${link}`;
}

/** What is said of a policy whose run has not come yet. */
const PLAYING = "still playing";

/** Return the policies of the day as the page lists them: what each came to, and whether it is ready and took more moves.
 * @param {Task} task @param {Answers.PolicyOfDay[]} policies @param {number | null} moves of the player, null without a success
 * @returns {Daily.PolicyRow[]} */
export const policyRows = (task, policies, moves) => policies.map((policy) => ({
  name: task.nameOf(policy.name), text: policyText(task, policy), isReady: policy.state === "ready",
  isBeaten: policy.state === "ready" && moves !== null && (policy.moves === null || policy.moves > moves),
}));

/** Return the rows as they are shown: those that are still played share one.
 * @param {Daily.PolicyRow[]} rows @returns {Pick<Daily.PolicyRow, "name" | "text">[]} */
export function shownRows(rows) {
  const open = rows.filter(({ text }) => text === PLAYING);
  if (open.length < 2) return rows;
  return [...rows.filter(({ text }) => text !== PLAYING), { name: many(open.length, "policy", "policies"), text: PLAYING }];
}

/** Return where a player stands among the people of the day and the policies that are listed.
 * @param {Answers.Attempt} attempt @param {Answers.PeopleOfDay} people @param {Daily.PolicyRow[]} rows */
export function rankText(attempt, people, rows) {
  if (!people.you) return attempt.unranked ? `This attempt has no rank: ${attempt.unranked}.` : "";
  const among = people.players > 1 ? `Rank ${people.you.rank} of ${many(people.players, "person", "people")} today` : "You are the first person today";
  const ready = rows.filter(({ isReady }) => isReady).length;
  const beaten = rows.filter(({ isBeaten }) => isBeaten).length;
  if (!ready) return `${among}.`;
  const isWhole = ready === rows.length;
  if (ready === 1) return `${among}, and ${beaten ? "" : "not "}better than the one policy${isWhole ? "" : " that is ready"}.`;
  const share = beaten === 0 ? "none of" : beaten === ready ? "all" : `${beaten} of`;
  return `${among}, and better than ${share} ${ready} policies${isWhole ? "" : " that are ready"}.`;
}

/** @param {Task} task @param {Answers.PeopleOfDay} people @returns how many people stand behind a distribution */
export function peopleText({ target }, { players, unfinished }) {
  if (!players) return "Nobody has a rank yet.";
  const rest = unfinished ? `; ${unfinished} of them did not reach ${target}` : "";
  return `${many(players, "person", "people")}${rest}. Each has one attempt.`;
}

/** Return the best of a day as rows, the best first: people who are level share one.
 * @param {Task} task @param {Answers.Result[]} table
 * @returns {Daily.PeopleRow[]} */
export function bestRows(task, table) {
  /** @type {Daily.PeopleRow[]} */
  const rows = [];
  for (const person of table) {
    const text = resultText(task, person);
    const level = rows.find((row) => row.rank === person.rank && row.text === text);
    if (!level) rows.push({ rank: person.rank, text, people: 1, you: person.you, episode: person.episode ?? null });
    else Object.assign(level, { people: level.people + 1, you: level.you || person.you, episode: (person.you && person.episode) || level.episode });
  }
  return rows;
}

/** @param {Daily.PeopleRow} row @returns who stands in it: "1. You and 3 people" */
export const whoText = ({ rank, people, you }) => {
  const others = many(you ? people - 1 : people, "person", "people");
  const names = !you ? (people > 1 ? others : "A person") : people > 1 ? `You and ${others}` : "You";
  return `${rank}. ${names}`;
};

/** @param {Task} task @param {Answers.PolicyOfDay} policy @returns what a policy did */
export function policyText(task, { state, moves, coverage }) {
  if (state !== "ready") return state === "failed" ? "not available" : PLAYING;
  if (moves !== null) return many(moves, "move");
  const share = coverage === null ? null : task.shareText?.(coverage);
  return share ? `stopped with ${share}` : `did not reach ${task.target}`;
}
