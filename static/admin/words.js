// The operator's console in words: times, sizes, stages, what needs attention. No document here.
import { many } from "../common/words.js";

const NO_ID = "no outside id";
/** The stages of people who are through. */
const THROUGH = ["debrief", "complete"];
/** @type {Record<string, string>} */
const STAGES = { consent: "Consent", instructions: "Instructions", tutorial: "Tutorial", questions: "Questions", warm_up: "Warm-up", ranked: "Ranked", debrief: "Debrief", complete: "Complete", withdrawn: "Withdrawn" };
/** How people come into a study. */
export const RECRUITMENT = {
  invitation: "By invitation: each link lets one person in, and is used up when they agree to take part.",
  panel: "From a panel: whoever comes with a new id of the site that sent them may take part.",
  open: "Open: whoever has the address may take part, more than once from another browser.",
};
/** @param {string} stage */
export const stageName = (stage) => STAGES[stage] ?? stage;

/** @param {number} ms since then */
export function ago(ms) {
  const s = Math.max(0, Math.round(ms / 1000));
  if (s < 10) return "now";
  if (s < 60) return `${s} s ago`;
  if (s < 3600) return `${Math.floor(s / 60)} min ago`;
  if (s < 86400) return `${Math.floor(s / 3600)} h ago`;
  return `${Math.floor(s / 86400)} d ago`;
}

/** @param {number} bytes */
export function size(bytes) {
  const units = ["B", "kB", "MB", "GB", "TB"];
  let k = 0;
  while (bytes >= 1000 && k < units.length - 1) { bytes /= 1000; k += 1; }
  return `${k === 0 || bytes >= 100 ? Math.round(bytes) : bytes.toFixed(1)} ${units[k]}`;
}

/** @param {Admin.ConsoleStudy} study @returns the line under a study's title */
export function summary(study) {
  const people = study.participants.filter(({ kind }) => kind === "human");
  const done = people.filter(({ stage }) => THROUGH.includes(stage)).length;
  const scripts = study.participants.length - people.length;
  const who = people.length ? `${many(people.length, "person", "people")} of ${study.planned} planned, ${done} through` : `nobody of ${study.planned} planned has joined yet`;
  const day = new Date(study.closed_ms ?? study.frozen_ms).toISOString().slice(0, 10);
  return `${study.where}, ${study.warm_up} warm-up and ${many(study.ranked, "ranked episode")}. ${study.status === "open" ? "Open since" : "Closed on"} ${day}: `
    + `${who}${scripts ? `, and ${many(scripts, "script")} outside of every human score` : ""}.`;
}

/** Return what the operator should look at, the worst first.
 * @param {Admin.ConsoleStudy} study @param {Admin.ServerHealth | null} health
 * @returns {{text: string, detail: string, isWarning: boolean}[]} */
export function attention({ participants, labels }, health) {
  /** @type {{text: string, detail: string, isWarning: boolean}[]} */
  const found = [];
  const people = participants.filter(({ kind }) => kind === "human");
  const named = (/** @type {Admin.Participant[]} */ list) => list.slice(0, 6).map(({ label }) => label).join(", ") + (list.length > 6 ? " \u2026" : "");
  if (health?.check && !health.check.is_whole) found.push({ text: "The database is damaged", detail: health.check.result, isWarning: true });
  if (health?.disk.is_low) found.push({ text: "The disk is nearly full", detail: `${size(health.disk.free)} left`, isWarning: true });
  const left = people.filter(({ stage }) => stage === "withdrawn");
  if (left.length) {
    const from = new Map();
    for (const { left_at: stage } of left) from.set(stage ?? "consent", (from.get(stage ?? "consent") ?? 0) + 1);
    found.push({ text: `${many(left.length, "person", "people")} left the study`, detail: [...from].map(([stage, count]) => `${count} at ${stageName(stage).toLowerCase()}`).join(", "), isWarning: false });
  }
  const asking = people.filter(({ asks_erasure: asks }) => asks);
  if (asking.length) found.push({ text: `${many(asking.length, "person asks", "people ask")} to be erased (humanplay forget)`, detail: asking.map(({ label }) => label).join(", "), isWarning: true });
  const quiet = people.filter(({ is_quiet: isQuiet }) => isQuiet);
  if (quiet.length) found.push({ text: `${many(quiet.length, "person", "people")} without a sign for half an hour`, detail: named(quiet), isWarning: true });
  const off = people.filter(({ deviations }) => deviations);
  if (off.length) found.push({ text: `${many(off.length, "person", "people")} with a deviation`, detail: named(off), isWarning: true });
  const twice = people.filter(({ repeated }) => repeated.some((sign) => sign !== NO_ID));
  if (twice.length) found.push({ text: `${many(twice.length, "person", "people")} with a sign of taking part twice`, detail: named(twice), isWarning: true });
  const unnamed = people.filter(({ repeated }) => repeated.includes(NO_ID));
  if (unnamed.length) found.push({ text: `${many(unnamed.length, "person", "people")} without an outside id`, detail: named(unnamed), isWarning: false });
  for (const { label, episodes, participants: who } of labels) {
    const whose = episodes ? `on ${many(episodes, "episode")}` : `of ${many(who.length, "person", "people")}`;
    found.push({ text: `\u201c${label}\u201d ${whose}`, detail: who.slice(0, 6).join(", ") + (who.length > 6 ? " \u2026" : ""), isWarning: false });
  }
  return found.sort((a, b) => Number(b.isWarning) - Number(a.isWarning));
}

/** @typedef {{name: string, number: string, detail: string, isWarning: boolean}} Glance */

/** Return what an operator looks at first: recruitment, quality, payments, disk.
 * @param {Admin.ConsoleStudy} study @param {Admin.ServerHealth} health @returns {Glance[]} */
export function glance(study, health) {
  const { disk, watched } = health;
  const people = study.participants.filter(({ kind }) => kind === "human");
  const through = people.filter(({ stage }) => THROUGH.includes(stage)).length;
  const agreed = people.filter(({ stage, left_at: left }) => stage !== "consent" && left !== "consent").length;
  const places = study.cap === null ? "" : `, ${study.places_taken} of ${many(study.cap, "place")} taken`;
  const links = study.invitations.filter(({ state }) => state === "issued").length;
  const warnings = attention(study, health).filter(({ isWarning }) => isWarning).length;
  const flagged = study.labels.reduce((sum, { episodes }) => sum + episodes, 0);
  const without = study.outcomes.filter(({ text }) => !text).length;
  const age_ms = 1000 * watched.backup_age_seconds;
  return [
    { name: "Recruitment", number: `${through} of ${study.planned}`, detail: `have played all; ${many(people.length, "person has", "people have")} come${places}${links ? `, ${many(links, "link")} not opened` : ""}`, isWarning: false },
    { name: "Quality", number: String(warnings), detail: `${warnings === 1 ? "warning" : "warnings"} below; ${many(flagged, "flag")} on episodes`, isWarning: warnings > 0 },
    { name: "Payments", number: String(agreed), detail: `agreed to take part; ${without ? `${many(without, "outcome has", "outcomes have")} no text yet` : "every outcome has a text"}`, isWarning: false },
    { name: "Disk", number: size(disk.free), detail: `free; ${age_ms < 0 ? "no backup is made" : `backup ${ago(age_ms)}`}`, isWarning: disk.is_low },
  ];
}

/** @param {Admin.Invitation[]} invitations @returns how many invitations are in each state, those in none left out */
export function invitationCounts(invitations) {
  const states = /** @type {const} */ (["issued", "opened", "used", "revoked"]);
  const counts = states.map((state) => /** @type {const} */ ([state, invitations.filter((each) => each.state === state).length]));
  return counts.filter(([, count]) => count).map(([state, count]) => `${count} ${state === "issued" ? "not opened yet" : state === "opened" ? "opened, not agreed to yet" : state}`).join(", ");
}

/** @param {Task} task @param {Record<string, number>} outcomes @returns the endings, the commonest first */
export const endings = (task, outcomes) => Object.entries(outcomes).sort((a, b) => b[1] - a[1]).map(([outcome, count]) => `${count} ${outcome === "abandoned" ? "given up" : task.status(outcome)}`).join(", ");

/** @param {Admin.Participant} person @param {Admin.ConsoleStudy["labels"]} labels @returns the flags of one participant */
export function flags(person, labels) {
  const own = labels.filter(({ participants }) => participants.includes(person.label)).map(({ label }) => label);
  if (person.deviations) own.unshift("deviation");
  if (person.supervised_ms !== null) own.unshift("supervised");
  if (person.is_quiet) own.unshift("no sign for half an hour");
  own.push(...person.repeated, ...person.not_attested);
  return own.join(", ");
}

/** Return where a mean stands between the ends of its measure, in percent.
 * @param {number} value @param {number} low @param {number} high */
export const place = (value, low, high) => Math.min(100, Math.max(0, (100 * (value - low)) / (high - low)));

/** Return an export in words; its files are links next to it.
 * @param {Admin.Export | null} made @param {string} before @param {number} now_ms */
export function exportText(made, before, now_ms) {
  if (!made) return before;
  if (made.state === "making") return `Being made, begun ${ago(now_ms - made.began_ms)}.`;
  return made.state === "failed" ? `Not made: ${made.error}` : `Made ${ago(now_ms - made.began_ms)}:`;
}
