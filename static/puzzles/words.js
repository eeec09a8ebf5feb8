// The sentences of the puzzles' page, and the streak; no document here, so that node can test every one.
import { capital, many } from "../common/words.js";

/** @param {Puzzles.Answered} stored of the days, whatever the browser holds @param {string} day @returns {Puzzles.Choice[]} */
export function choicesOn(stored, day) {
  const choices = stored?.[day];
  return Array.isArray(choices) ? choices.filter((choice) => typeof choice?.id === "string" && typeof choice.answer === "string") : [];
}

/** @param {string} day "2026-11-22" @returns {string} the one before */
const dayBefore = (day) => new Date(Date.parse(`${day}T00:00:00Z`) - 86_400_000).toISOString().slice(0, 10);

/** Return on how many days in a row all puzzles were answered, up to today or to yesterday.
 * @param {Puzzles.Answered} stored @param {string} today @param {number} count puzzles a day */
export function streak(stored, today, count) {
  const isDone = (/** @type {string} */ day) => choicesOn(stored, day).length >= count;
  let [day, days] = [isDone(today) ? today : dayBefore(today), 0];
  for (; isDone(day); day = dayBefore(day)) days += 1;
  return days;
}

/** @param {number} moves rounded @returns {string} */
const hereText = (moves) => (moves > 0 ? `${moves} on this terrain` : moves === 0 ? "none on this terrain" : `on this terrain it would have cost ${many(-moves, "move")}`);

/** @param {string} chosen move @param {Answers.PuzzleAnswer} answer @returns {string} the headline after an answer */
export const verdictText = (chosen, { best }) => (chosen === best ? `${capital(best)} is right.` : `${capital(best)} was better than ${chosen}.`);

/** @param {string} chosen @param {Answers.PuzzleAnswer} answer @returns {string} what the best move saves */
export function savesText(chosen, { best, means, saves, here }) {
  const average = `${capital(best)} saves ${many(Math.round(saves), "move")} on average against the next best; ${hereText(here)}.`;
  const lost = Math.round((means[chosen] ?? 0) - means[best]);
  return chosen === best ? average : `${capital(chosen)} costs ${many(lost, "move")} more on average. ${average}`;
}

/** @param {Puzzles.Choice[]} choices @param {Record<string, Answers.PuzzleAnswer>} answers @returns {string} what a day came to */
export function doneText(choices, answers) {
  const right = choices.filter(({ id, answer }) => answers[id]?.best === answer).length;
  return `That was today: ${right} of ${choices.length} right.`;
}
