// The sentences of the puzzles' page, and the streak; no document here, so that node can test every one.
import { capital, many } from "../common/words.js";

/** @param {Puzzles.Answered} stored of the days, whatever the browser holds @param {string} day @returns {Puzzles.Choice[]} */
export function choicesOn(stored, day) {
  const choices = stored?.[day];
  return Array.isArray(choices) ? choices.filter((choice) => typeof choice?.id === "string" && typeof choice.answer === "string") : [];
}

/** @param {string} day "2026-11-22" @returns the day before it */
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

/** @param {Pick<Answers.PuzzleAnswer, "best" | "means">} answer @returns {string} the move that comes next to the best one */
const nextBest = ({ best, means }) => Object.keys(means).filter((move) => move !== best).sort((one, other) => means[one] - means[other])[0];

/** @param {string} chosen @param {Answers.PuzzleAnswer} answer @returns {string} what the best move saves against the chosen one, else the next best */
export function savesText(chosen, answer) {
  const { best, means, saves, here } = answer;
  if (chosen !== best && chosen !== nextBest(answer)) return `${capital(chosen)} costs ${many(Math.round(means[chosen] - means[best]), "move")} more on average.`;
  return `${capital(best)} saves ${many(Math.round(saves), "move")} on average against ${chosen === best ? "the next best" : chosen}; ${hereText(here)}.`;
}

/** @param {string} chosen @param {Answers.PuzzleAnswer} answer @returns {string} the move that the best one is held against */
const otherMove = (chosen, answer) => (chosen === answer.best ? nextBest(answer) : chosen);

/** Return the cells that the best move brings in sight and the chosen one, else the next best, leaves for later; none where
 * the best one brings no more in sight.
 * @param {string} chosen @param {Answers.PuzzleAnswer} answer */
export function cellsLeft(chosen, answer) {
  const { best, shows } = answer;
  const others = shows[otherMove(chosen, answer)] ?? [];
  if (shows[best].length <= others.length) return [];
  const shown = new Set(others.map(String));
  return shows[best].filter((cell) => !shown.has(String(cell)));
}

/** Return why the best move is better: the cells it shows first, else that it saves later, which only a saving on this terrain says.
 * @param {string} chosen @param {Answers.PuzzleAnswer} answer @returns {string} */
export function whyText(chosen, answer) {
  const { best, shows, here } = answer;
  const count = cellsLeft(chosen, answer).length;
  const other = otherMove(chosen, answer);
  if (count) return `Green: ${many(count, "cell")} that ${best} brings in sight within eight moves here; ${other} leaves ${count === 1 ? "it" : "them"} for later.`;
  const [cells, others] = [shows[best].length, shows[other]?.length ?? 0];
  if (here <= 0) return "";
  const brought = cells === others ? `${best} and ${other} each bring ${many(cells, "cell")} in sight` : `${best} brings ${many(cells, "cell")} in sight and ${other} ${others}`;
  return `Within eight moves here ${brought}: what ${best} saves comes later on the way.`;
}

/** @param {Puzzles.Choice[]} choices @param {Record<string, Answers.PuzzleAnswer>} answers @returns whether each was right */
const marksOf = (choices, answers) => choices.map(({ id, answer }) => answers[id]?.best === answer);

/** @param {boolean[]} marks @returns {string} */
const rightText = (marks) => `${marks.filter(Boolean).length} of ${marks.length} right`;

/** @param {Puzzles.Choice[]} choices @param {Record<string, Answers.PuzzleAnswer>} answers @returns {string} what a day came to */
export const doneText = (choices, answers) => `That was today: ${rightText(marksOf(choices, answers))}.`;

/** Return the text to share: it names no move.
 * @param {string} title of the task @param {string} day in words @param {Puzzles.Choice[]} choices
 * @param {Record<string, Answers.PuzzleAnswer>} answers @param {string} link */
export function shareText(title, day, choices, answers, link) {
  const marks = marksOf(choices, answers);
  return `${title} puzzles, ${day}: ${rightText(marks)} ${marks.map((isRight) => (isRight ? "\u2713" : "\u2715")).join("")}\n${link}`;
}
