// The sentences of a challenge; no document here, so that node can test every one.
import { many } from "../common/words.js";

/** @param {Pick<Course, "outcome" | "actions">} run @returns {string} what is to be beaten */
export const headline = ({ outcome, actions }) => (outcome === "explored" ? `${many(actions.length, "move")}. Beat it.` : "This terrain was not finished. Finish it.");

/** @param {Answers.Challenger} person @returns {string} "79 moves, by somebody" */
export const challengerText = ({ name, moves }) => `${many(moves, "move")}, by ${name ?? "somebody"}`;
