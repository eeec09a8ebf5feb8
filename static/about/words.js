// @ts-check
// What stands under each picture of a board. No document here, so that node can test it.
import { many } from "../common/words.js";

/** @param {string} name start, way, done or crash @param {ShownBoard} board @returns the sentence about a board */
export function boardLine(name, { actions, coverage }) {
  const percent = `${Math.floor(100 * coverage)}\u00a0%`;
  const moves = many(actions.length, "move");
  if (name === "start") return `The lidar shows the first ${percent} before any move.`;
  if (name === "done") return `${percent} is known after ${moves}.`;
  if (name === "crash") return `Crashed at ${percent} after ${moves}.`;
  return `${percent} is known after ${moves}. The line is the path.`;
}
