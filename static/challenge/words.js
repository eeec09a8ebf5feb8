// The sentences of a challenge; no document here, so that node can test every one.
import { many } from "../common/words.js";

/** @param {Answers.Challenger} person @returns {string} "79 moves, by somebody" */
export const challengerText = ({ name, moves }) => `${many(moves, "move")}, by ${name ?? "somebody"}`;
