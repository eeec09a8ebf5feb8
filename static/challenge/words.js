// The sentences of a challenge; no document here, so that node can test every one.
import { many } from "../common/words.js";

/** @param {Task} task @param {Pick<Course, "outcome" | "actions">} run @returns {string} what is to be beaten */
export const headline = ({ successes, round }, { outcome, actions }) => (successes.includes(outcome ?? "") ? `${many(actions.length, "move")}. Beat it.` : `This ${round} was not finished. Finish it.`);

/** @param {Answers.Challenger} person @returns {string} "79 moves, by somebody" */
export const challengerText = ({ name, moves }) => `${many(moves, "move")}, by ${name ?? "somebody"}`;
