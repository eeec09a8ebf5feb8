// The study's sentences; no document here, so node can test every one.
import { many } from "../common/words.js";
import { goesOn, isNewTry } from "./state.js";

/** Return the participant's progress, for the bar.
 * @param {Study.Participant} participant @param {boolean} isPlaying while an episode runs its number counts as begun */
export function progress(participant, isPlaying) {
  const { stage, questions, task } = participant;
  if (participant.block && !isPlaying) return "Questions";
  const part = stage === "warm_up" || stage === "ranked" ? participant[stage] : null;
  const name = stage === "ranked" ? "Ranked" : `Warm-up${tryLine(participant)}`;
  if (part) return isPlaying ? `${name}: ${task.round} ${Math.min(part.of, part.done + 1)} of ${part.of}` : `${name}: ${part.done} of ${part.of} done`;
  return { consent: "Consent", instructions: "Instructions", tutorial: "Trying the keys", questions: questionsTitle(questions.length), debrief: "Debrief",
    complete: "Finished", withdrawn: "Left the study" }[/** @type {"consent"} */ (stage)] ?? "";
}

const COUNTS = ["No", "One", "Two", "Three", "Four", "Five"];

/** Return how many questions there are, as a heading.
 * @param {number} count @param {string} [kind] of question, as in "short" */
export const questionsTitle = (count, kind = "") => `${COUNTS[count] ?? count} ${kind && `${kind} `}question${count === 1 ? "" : "s"}`;

/** Return the share of the whole study, 0..1: each terrain weighs the same, the rest a little.
 * @param {Study.Participant} participant */
export function share({ stage, warm_up, ranked }) {
  const terrains = warm_up.of + ranked.of;
  const before = { consent: 0, instructions: 1, tutorial: 2, questions: 3, warm_up: 4, ranked: 4, debrief: 5, complete: 6, withdrawn: 0 }[stage];
  return (before + warm_up.done + ranked.done) / (terrains + 6);
}

/** @param {string} text @returns what the server said as a sentence of its own */
export const sentence = (text) => text && `${text[0].toUpperCase()}${text.slice(1)}${/[.!?]$/.test(text) ? "" : "."}`;

/** Return until when a session is supervised, in local time; nothing when it is not.
 * @param {number | null} until_ms @param {number} now_ms */
export const supervisedLine = (until_ms, now_ms) => until_ms !== null && now_ms < until_ms
  ? `Supervised until ${new Date(until_ms).toLocaleTimeString([], { hour: "2-digit", minute: "2-digit" })}.` : "";

/** @param {number} until_ms @returns for how long a link to here holds */
export const linkHolds = (until_ms) => `It holds until ${new Date(until_ms).toLocaleTimeString([], { hour: "2-digit", minute: "2-digit" })}, and for one device.`;

/** @param {Study.Participant} participant @returns which try at the practice it is, from the second one on */
const tryLine = ({ practice }) => (practice && practice.number > 1 ? `, try ${practice.number} of ${practice.tries}` : "");

/** @param {Study.Participant} participant @returns the screen before the first episode of a phase */
export function readyText(participant) {
  const { stage, warm_up, ranked, practice, task: { round, clock } } = participant;
  if (stage === "tutorial") return { title: "Trying the keys", lines: [`One ${round} to try the keys on. Nothing you do here is part of your result.`], go: "Try the keys" };
  if (stage === "warm_up") {
    const isAgain = practice !== null && practice.number > 1;
    const again = isAgain ? "The practice is not passed yet." : "";
    const begin = warm_up.done > 0 ? `You have done ${warm_up.done} of ${warm_up.of}.` : again;
    return { title: `Warm-up${tryLine(participant)}`, lines: [begin,
      `${many(warm_up.of, round)} to get used to the task. After each you see how you did. They do not count for your result.`, practice?.text ?? ""].filter(Boolean),
    go: warm_up.done > 0 ? "Go on" : isAgain ? "Start this try" : "Start the warm-up" };
  }
  const isFirst = ranked.done === 0;
  return { title: isFirst ? "Now it counts" : `Ranked ${round}s`, lines: isFirst
    ? [`${many(ranked.of, round)} that count. Scores stay hidden until the end, for everybody; you see your moves and your board.`,
      `Every ${round} that begins is part of your result: reloading the page brings it back as it stood.`,
      clock ? `Time runs, ${clock} frames a second, from a countdown on. Keys can be held. Where you have to stop, pause: time stands still then.`
        : "There is no clock. Think as long as you like; only moves count."]
    : [`You have done ${ranked.done} of ${ranked.of}.`], go: isFirst ? `Start the first ${round}` : "Go on" };
}

/** @param {Study.Participant} participant @returns the break screen */
export const breakLine = ({ ranked, task }) =>
  `${many(ranked.done, task.round)} done, ${ranked.of - ranked.done} to go. Nothing is running: rest as long as you like, and close this page if you want to. The same address in this browser brings you back here.`;

/** Return the card at the end of an episode: warm-up shows the score, ranked keeps it.
 * @param {Frame} frame @param {Study.Participant} participant */
export function endCard(frame, participant) {
  const { title, line, figures, advice } = participant.task.trialEnding(frame, participant.rules.coverage);
  return { title, line, figures, note: endNote(frame, advice, participant), next: endNext(participant, participant.phase) };
}

/** @param {Frame} frame @param {string} advice of the task after trying the keys @param {Study.Participant} participant */
function endNote({ score: scored }, advice, participant) {
  const { phase, stage, rules, task, block } = participant;
  if (phase === "tutorial") return advice;
  if (phase === "warm_up" && isNewTry(participant)) return `That was the last ${task.round} of this try. The practice is not passed yet: another try follows.`;
  if (phase === "warm_up") return stage === "ranked" ? `That was the last ${task.round} of the warm-up.` : `Fewer moves to ${rules.coverage} are better. This one does not count.`;
  return stage === "debrief" ? `That was the last ${task.round}. ${block ? "Some questions follow, then you will see how you did." : "Now you will see how you did."}` : scored === null ? "Its score is kept for the end." : "";
}

/** @param {Study.Participant} participant @param {Study.Participant["phase"]} phase */
function endNext(participant, phase) {
  const { length } = participant.questions;
  if (phase === "tutorial") return length ? `Go on to ${questionsTitle(length).toLowerCase()}` : "Go on";
  return goesOn(participant) ? `Next ${participant.task.round}` : "Go on";
}

/** @param {Study.Participant} participant @returns the heading for whoever does not go on */
export const withdrawnTitle = ({ ending }) => ({ unfit_device: "This device does not fit", over_quota: "This study is full", failed_questions: "The questions are over", failed_practice: "The practice is over", failed_attention: "The study is over for you" }[/** @type {"unfit_device"} */ (ending?.outcome)] ?? "You have left the study");

/** @param {Study.Participant} participant @returns whether they can close the page, or take something with them first */
export const withdrawnLead = ({ ending }) => (ending?.code || ending?.address || ending?.sentence ? "Nothing more is recorded. Please read to the end of this page." : "Nothing more is recorded. You can close this page.");

/** @param {number | null} left @returns how often the questions may be answered */
export const triesLine = (left) => (left === null ? "You can answer as often as you need to" : `You can answer ${left === 1 ? "once more" : many(left, "time")}`);

/** @param {Study.Participant} participant @returns the button that leads from the debrief to the end */
export const finish = ({ ending }) => (ending?.code ? "Finish and get my completion code" : "Finish");

/** @param {Task} task @param {Answers.Debrief} debrief @returns the debrief in one sentence */
export function debriefLine(task, { policy }) {
  const { mean_steps_warm_up: theirs = null, own_mean_steps_warm_up: mine = null } = policy ?? {};
  if (!policy || theirs === null || mine === null) return "";
  const gap = Math.abs(mine - theirs);
  const comparison = gap < 0.05 ? "as many as you" : `${gap.toFixed(1)} ${theirs < mine ? "fewer" : "more"} than you`;
  return `On the warm-up ${task.round}s ${task.nameOf(policy.name)}, a policy, needed ${theirs.toFixed(1)} moves on average, ${comparison} (${mine.toFixed(1)}).`;
}
