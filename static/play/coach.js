// @ts-check
// What the page says about the first moves of somebody's first episode. No document here, so that node can test every sentence.
import { many } from "../common/words.js";

/** The first moves, each of which says how many cells it uncovered. */
const FIRST_MOVES = 8;
/** @type {Record<string, [number, number]>} */
const AHEAD = { north: [-1, 0], east: [0, 1], south: [1, 0], west: [0, -1] };

/** @param {Frame} frame @returns what lies in front of the rover: the grid's character, or "edge" */
export function ahead({ grid, position: [row, col], heading }) {
  const [down, right] = AHEAD[heading] ?? [0, 0];
  return grid[row + down]?.[col + right] ?? "edge";
}

/** The sentences in the order of their weight; the first one that fits and has not been said is said. What the lidar
 * does comes with the first move, or with the one after it where a rock lies ahead.
 * @type {[string, (after: Frame, gained: number) => boolean, string][]} */
const LINES = [
  ["rock", (after) => ahead(after) === "#", "A rock is right in front of you. Hitting it ends the episode."],
  ["edge", (after) => after.step > 1 && ahead(after) === "edge", "The edge of the map is right in front of you. Driving over it ends the episode."],
  ["first", () => true, "Your lidar uncovers what is in sight."],
  ["rocks", ({ grid }) => grid.some((line) => line.includes("#")), "Pale blocks are rocks. Drive round them."],
  ["nothing", (_after, gained) => gained === 0, "Nothing new there. Head for the dark."],
  ["quarter", ({ coverage }) => coverage >= 0.25 && coverage < 0.5, "A quarter of the ground is on the map. Rocks hide what is behind them."],
  ["half", ({ coverage }) => coverage >= 0.5 && coverage < 0.9, "Half of the ground. Plan a way that passes each dark patch once."],
  ["most", ({ coverage }) => coverage >= 0.9, "Nearly there. The last dark cells hide behind rocks and in corners."],
];

/** Return what to say after a move; null when there is nothing to say.
 * @param {Frame} before @param {Frame} after @param {ReadonlySet<string>} said the ids of what was said before
 * @returns {Play.Hint | null} */
export function hintAfter(before, after, said) {
  if (after.outcome || before.episode !== after.episode || after.step <= before.step) return null;
  const gained = after.discovered - before.discovered;
  const gain = gained > 0 && after.step <= FIRST_MOVES ? `+${many(gained, "new cell")}` : "";
  const [id, , line] = LINES.find(([name, fits]) => !said.has(name) && fits(after, gained)) ?? ["", null, ""];
  return gain || line ? { id, gain, line } : null;
}
