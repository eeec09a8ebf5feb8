// The study's sentences; node can test every one.
import { fixed, plural, t, timeText } from "../common/texts.js";
import { goesOn, isNewTry } from "./state.js";

/** Return the participant's progress, for the bar.
 * @param {Study.Participant} participant @param {boolean} isPlaying while an episode runs its number counts as begun */
export function progress(participant, isPlaying) {
  const { stage, questions, task } = participant;
  if (participant.block && !isPlaying) return t("block.step", "Questions");
  const part = stage === "warm_up" || stage === "ranked" ? participant[stage] : null;
  const name = stage === "ranked" ? t("progress.ranked", "Ranked") : warmUpTitle(participant);
  if (part) {
    return isPlaying ? t("progress.playing", "{name}: {round} {number} of {of}", { name, round: task.round, number: Math.min(part.of, part.done + 1), of: part.of })
      : t("progress.done", "{name}: {number} of {of} done", { name, number: part.done, of: part.of });
  }
  return { consent: t("progress.consent", "Consent"), instructions: t("progress.instructions", "Instructions"), tutorial: t("ready.tutorial_title", "Trying the keys"),
    questions: questionsTitle(questions.length), debrief: t("debrief.step", "Debrief"), complete: t("complete.step", "Finished"),
    withdrawn: t("progress.left", "Left the study") }[/** @type {"consent"} */ (stage)] ?? "";
}

/** @param {number} count @returns how many questions there are, as a heading */
export const questionsTitle = (count) => headings(count, plural("questions.many", count, "{n} question", "{n} questions"));

/** @param {number} count @returns the same for the questions on the instructions */
export const shortQuestionsTitle = (count) => headings(count, plural("questions.many_short", count, "{n} short question", "{n} short questions"));

/** Where the language has words for them, small numbers stand in a heading as words.
 * @param {number} count @param {string} text that begins with the number */
function headings(count, text) {
  const words = t("questions.numbers", "No One Two Three Four Five").split(" ");
  return text.replace(/^\d+/, (number) => words[count] ?? number);
}

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
  ? t("supervise.until", "Supervised until {time}.", { time: timeText(until_ms) }) : "";

/** @param {number} until_ms @returns for how long a link to here holds */
export const linkHolds = (until_ms) => t("elsewhere.holds", "It holds until {time}, and for one device.", { time: timeText(until_ms) });

/** @param {Study.Participant} participant @returns the warm-up, and which try at the practice it is, from the second one on */
const warmUpTitle = ({ practice }) => (practice && practice.number > 1
  ? t("progress.try", "Warm-up, try {number} of {of}", { number: practice.number, of: practice.tries }) : t("progress.warm_up", "Warm-up"));

/** @param {string} round */
const nouns = (round) => ({ round, rounds: `${round}s` });

/** @param {Study.Participant} participant @returns the screen before the first episode of a phase */
export function readyText(participant) {
  const { stage, task: { round } } = participant;
  if (stage === "warm_up") return warmUpText(participant);
  if (stage === "ranked") return rankedText(participant);
  return { title: t("ready.tutorial_title", "Trying the keys"), go: t("ready.tutorial_go", "Try the keys"),
    lines: [t("ready.tutorial", "One {round} to try the keys on. Nothing you do here is part of your result.", nouns(round))] };
}

/** @param {Study.Participant} participant */
function warmUpText(participant) {
  const { warm_up, practice, task: { round } } = participant;
  const isAgain = practice !== null && practice.number > 1;
  const again = isAgain ? t("ready.not_passed", "The practice is not passed yet.") : "";
  const begin = warm_up.done > 0 ? doneLine(warm_up) : again;
  const start = isAgain ? t("ready.try_go", "Start this try") : t("ready.warm_up_go", "Start the warm-up");
  return { title: warmUpTitle(participant), go: warm_up.done > 0 ? t("block.go", "Go on") : start, lines: [
    begin,
    plural("ready.warm_up", warm_up.of, "{n} {round} to get used to the task. After each you see how you did. They do not count for your result.",
      "{n} {rounds} to get used to the task. After each you see how you did. They do not count for your result.", nouns(round)),
    practice?.text ?? "",
  ].filter(Boolean) };
}

/** @param {Study.Participant} participant */
function rankedText({ ranked, task: { round, clock } }) {
  if (ranked.done > 0) return { title: t("ready.ranked_title", "Ranked {rounds}", nouns(round)), lines: [doneLine(ranked)], go: t("block.go", "Go on") };
  return { title: t("ready.counts_title", "Now it counts"), go: t("ready.counts_go", "Start the first {round}", nouns(round)), lines: [
    plural("ready.counts", ranked.of, "{n} {round} that count. Scores stay hidden until the end, for everybody; you see your moves and your board.",
      "{n} {rounds} that count. Scores stay hidden until the end, for everybody; you see your moves and your board.", nouns(round)),
    t("ready.counts_each", "Every {round} that begins is part of your result: reloading the page brings it back as it stood.", nouns(round)),
    clock ? t("ready.clock", "Time runs, {frames} frames a second, from a countdown on. Keys can be held. Where you have to stop, pause: time stands still then.", { frames: clock })
      : t("ready.no_clock", "There is no clock. Think as long as you like; only moves count."),
  ] };
}

/** @param {{done: number, of: number}} part */
const doneLine = ({ done, of }) => t("ready.done", "You have done {number} of {of}.", { number: done, of });

/** @param {Study.Participant} participant @returns the break screen */
export const breakLine = ({ ranked, task }) => plural("break.line", ranked.done,
  "{n} {round} done, {left} to go. Nothing is running: rest as long as you like, and close this page if you want to. The same address in this browser brings you back here.",
  "{n} {rounds} done, {left} to go. Nothing is running: rest as long as you like, and close this page if you want to. The same address in this browser brings you back here.",
  { ...nouns(task.round), left: ranked.of - ranked.done });

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
  if (phase === "warm_up") {
    if (isNewTry(participant)) return t("end.try_over", "That was the last {round} of this try. The practice is not passed yet: another try follows.", nouns(task.round));
    return stage === "ranked" ? t("end.warm_up_over", "That was the last {round} of the warm-up.", nouns(task.round))
      : t("end.warm_up", "Fewer moves to {target} are better. This one does not count.", { target: rules.coverage });
  }
  if (stage !== "debrief") return scored === null ? t("end.score_kept", "Its score is kept for the end.") : "";
  return block ? t("end.over_questions", "That was the last {round}. Some questions follow, then you will see how you did.", nouns(task.round))
    : t("end.over", "That was the last {round}. Now you will see how you did.", nouns(task.round));
}

/** @param {Study.Participant} participant @param {Study.Participant["phase"]} phase */
function endNext(participant, phase) {
  const { length } = participant.questions;
  if (phase === "tutorial" && length) {
    const questions = questionsTitle(length);
    return t("end.to_questions", "Go on to {questions}", { questions: questions.charAt(0).toLowerCase() + questions.slice(1) });
  }
  return phase !== "tutorial" && goesOn(participant) ? t("end.next_round", "Next {round}", nouns(participant.task.round)) : t("block.go", "Go on");
}

/** @param {Study.Participant} participant @returns the heading for whoever does not go on */
export const withdrawnTitle = ({ ending }) => ({
  unfit_device: t("left.title_unfit", "This device does not fit"), over_quota: t("left.title_full", "This study is full"),
  failed_questions: t("left.title_questions", "The questions are over"), failed_practice: t("left.title_practice", "The practice is over"),
  failed_attention: t("left.title_attention", "The study is over for you"),
}[/** @type {"unfit_device"} */ (ending?.outcome)] ?? t("left.title", "You have left the study"));

/** @param {Study.Participant} participant @returns whether they can close the page, or take something with them first */
export const withdrawnLead = ({ ending }) => (ending?.code || ending?.address || ending?.sentence
  ? t("left.lead_read", "Nothing more is recorded. Please read to the end of this page.") : t("left.lead", "Nothing more is recorded. You can close this page."));

/** @param {number | null} left @returns what the questions are for, and how often they may be answered */
export const quizLead = (left) => (left === null
  ? t("questions.lead", "They make sure that the task is clear. You can answer as often as you need to; nothing here is part of your result.")
  : plural("questions.lead_tries", left, "They make sure that the task is clear. You can answer once more; nothing here is part of your result.",
    "They make sure that the task is clear. You can answer {n} times; nothing here is part of your result."));

/** @param {Study.Participant} participant @returns the button that leads from the debrief to the end */
export const finish = ({ ending }) => (ending?.code ? t("debrief.finish_code", "Finish and get my completion code") : t("debrief.finish", "Finish"));

/** @param {Task} task @param {Answers.Debrief} debrief @returns the debrief in one sentence */
export function debriefLine(task, { policy }) {
  const { mean_steps_warm_up: theirs = null, own_mean_steps_warm_up: mine = null } = policy ?? {};
  if (!policy || theirs === null || mine === null) return "";
  const gap = Math.abs(mine - theirs);
  const values = { ...nouns(task.round), policy: task.nameOf(policy.name), moves: fixed(theirs, 1), gap: fixed(gap, 1), own: fixed(mine, 1) };
  if (gap < 0.05) return t("debrief.as_many", "On the warm-up {rounds} {policy}, a policy, needed {moves} moves on average, as many as you ({own}).", values);
  return theirs < mine ? t("debrief.fewer", "On the warm-up {rounds} {policy}, a policy, needed {moves} moves on average, {gap} fewer than you ({own}).", values)
    : t("debrief.more", "On the warm-up {rounds} {policy}, a policy, needed {moves} moves on average, {gap} more than you ({own}).", values);
}
