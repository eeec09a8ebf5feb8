// @ts-check
// The first episode of somebody who has never been here: the prompt for the first key, and the coach for the moves after it. The
// policy's board comes once that episode has ended.
import { put } from "../common/page.js";
import { many } from "../common/words.js";
import { promptText } from "./words.js";

const VISITED = "mars.visited";

/**
 *   part     of the player's panel
 *   onEnded  the first episode has ended, and the page has room for two boards
 * @param {{page: Document, part: Record<string, HTMLElement>, storage: Storage, isTouch: boolean,
 *   onEnded: () => void}} how */
export function createFirstVisit({ page, part, storage, isTouch, onEnded }) {
  const { body } = page;
  /** @type {Set<string>} */
  const said = new Set();
  /** @type {Play.Hint | null} */
  let hint = null;
  let isCoaching = true;
  const isFirst = () => body.dataset.visit === "first";

  /** @param {GameState} state */
  function paint({ mode, player, link }) {
    const isDriven = isFirst() && (mode === "practice" || mode === "ranked");
    const frame = player?.frame;
    part.prompt.hidden = !isDriven || !frame || frame.step > 0 || frame.outcome !== null || link === "lost";
    if (!part.prompt.hidden) put(part["prompt-text"], promptText(isTouch));
    part.coach.hidden = !isDriven || !isCoaching || !hint || !frame || frame.step === 0;
    put(part["coach-gain"], hint?.gain ?? "");
    put(part["coach-line"], hint?.line ?? "");
  }
  part["coach-close"].addEventListener("click", () => {
    isCoaching = false;
    part.coach.hidden = true;
  });
  return {
    isFirst,
    /** Take note of a change of the player's board.
     * @param {GameState} before @param {GameState} after */
    follow(before, after) {
      const [was, is] = [before.player?.frame, after.player?.frame];
      if (!isFirst() || !is || was === is || after.mode === "watch") return;
      if (is.step > 0) storage.setItem(VISITED, "yes");
      hint = was ? hintAfter(was, is, said) : null;
      if (hint?.id) said.add(hint.id);
      if (!is.outcome || was?.episode !== is.episode) return;
      body.dataset.visit = "again";
      onEnded();
    },
    paint,
  };
}

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
