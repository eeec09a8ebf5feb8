// How the maze is drawn and told: its text, as every environment's that is shown as one, under the maze's own words.
import { taskOf as textOf } from "../picture/index.js";

/** @param {Answers.Task} about */
export function taskOf(about) {
  return { ...textOf(about), round: "maze", target: "the goal" };
}
