// The end card's question: where did I lose moves? The answers stand in a list, on the board and on the chart; each can be tried again.
import { ApiError } from "../../common/api.js";
import { create, put } from "../../common/page.js";
import { many } from "../../common/words.js";
import { cellAfter, markAt, WAYS } from "./ground.js";
import { chartMarkAt, numberAt, paintOnCurve, placeOnCurve } from "./loss_marks.js";
import { policyName } from "./names.js";

const ASK = "Where did I lose moves?";
/** Where the newest episode that tries another again is kept. */
const TRIED = "mars.tried";

/** @param {Mars.Frame | undefined} frame @returns whether all cells count, as the analysis of moves takes it */
const isWhole = (frame) => frame !== undefined && frame.cells === frame.rows * frame.cols;

/** @param {Mars.Board} board @param {Mars.CostlyMove} loss @returns {Mars.Board} a board as it was known before a costly move */
export function boardBefore(board, { step, grid, position, discovered, previous }) {
  const { frame, trail } = board;
  const coverage = discovered / frame.cells;
  return { ...board, trail: trail.slice(0, step + 1), frame: { ...frame, step, grid, position, discovered, coverage, heading: previous ?? "east", outcome: null } };
}

/**
 *   tryFrom   begins the same terrain in practice and makes the first moves of the episode once more
 *   storage   of this tab: what is tried again, and what it came to before
 * @param {{part: Record<string, HTMLElement>, canvas: HTMLCanvasElement, chart: HTMLElement,
 *   state: () => GameState, load: (episode: string) => Promise<Mars.Analysis>, tryFrom: (state: GameState, step: number,
 *   onBegun: (episode: string) => void) => void, storage: Storage, onChange: () => void}} how part of the player's panel, whose matrix is `canvas` */
export function createLosses({ part, canvas, chart, state, load, tryFrom, storage, onChange }) {
  const playerOf = () => /** @type {Mars.Board | null} */ (state().player);
  /** @type {string | null} the episode whose moves are shown or asked for */
  let episode = null;
  /** @type {Mars.Analysis | null} */
  let analysis = null;
  /** @type {number | null} */
  let pinned = null;
  /** @type {number | null} */
  let pointed = null;
  /** @type {Point[]} where the numbers stand on the chart */
  let onChart = [];
  /** @type {Mars.Marks | null} */
  let marks = null;
  const chosen = () => pointed ?? pinned;

  function changed() {
    part.losses.querySelectorAll("li").forEach((item, index) => {
      item.classList.toggle("is-chosen", index === chosen());
      item.querySelector(".loss")?.setAttribute("aria-pressed", String(index === pinned));
    });
    marks = analysis?.losses.length ? { losses: analysis.losses, chosen: chosen() } : null;
    onChange();
  }
  /** @param {number | null} index */
  function point(index) {
    if (index === pointed) return;
    pointed = index;
    changed();
  }
  /** @param {number} index */
  function pin(index) {
    pinned = pinned === index ? null : index;
    pointed = null;
    changed();
  }
  /** @param {Mars.Analysis | null} found */
  function show(found) {
    analysis = found;
    pinned = pointed = null;
    onChart = [];
    document.body.dataset.analysis = String(found !== null);
    put(part.ask, found ? "Back to both boards" : ASK);
    part.ask.hidden = false;
    changed();
  }
  function close() {
    episode = null;
    show(null);
    part.losses.hidden = true;
  }
  async function ask() {
    const player = playerOf();
    if (!player) return;
    const asked = episode = player.frame.episode;
    part.ask.hidden = true;
    part.losses.hidden = false;
    const time = player.frame.rows * player.frame.cols > 600 ? "On a board of this size that can take a minute." : "That takes a few seconds.";
    part.losses.replaceChildren(create("p", `Trying every other way you could have gone. ${time}`, { role: "status" }), create("progress", [], { "aria-label": "Judging your moves" }));
    try {
      const found = await load(asked);
      if (episode !== asked) return;
      paintList(found);
      show(found);
    } catch (error) {
      if (episode !== asked) return;
      const reason = error instanceof ApiError ? error.message : `Something went wrong on this page: ${error}`;
      part.losses.replaceChildren(create("p", `${reason.slice(0, 1).toUpperCase()}${reason.slice(1)}.`.replace(/\.\.$/, "."), { role: "status" }));
      part.ask.hidden = error instanceof ApiError && error.status === 422;
    }
  }
  /** @param {Mars.Analysis} found */
  function paintList(found) {
    const list = create("ol", found.losses.map((loss, index) => {
      const choose = create("button", [create("b", String(index + 1), { "aria-hidden": "true" }), create("span", sentenceOf(loss))],
        { type: "button", class: "loss", "aria-pressed": "false", "data-testid": `loss-${index + 1}` });
      const again = create("button", "Try from here", { type: "button", class: "quiet", "aria-label": `Try from here: move ${loss.step + 1}` });
      const item = create("li", [choose, again]);
      choose.addEventListener("click", () => pin(index));
      again.addEventListener("click", () => {
        const before = playerOf()?.frame;
        tryFrom(state(), loss.step, (begun) => storage.setItem(TRIED, JSON.stringify({ episode: begun, move: loss.step + 1, before: before?.outcome === "explored" ? before.step : null })));
      });
      item.addEventListener("pointerenter", (event) => { if (event.pointerType === "mouse") point(index); });
      item.addEventListener("pointerleave", (event) => { if (event.pointerType === "mouse") point(null); });
      item.addEventListener("focusin", () => { if (choose.matches(":focus-visible") || again.matches(":focus-visible")) point(index); });
      item.addEventListener("focusout", () => point(null));
      return item;
    }));
    const hint = found.losses.length ? [create("p", "Choose one to see the board as you saw it: your move is the dashed arrow, the better one is green, and green cells are what it would soon have shown.", { class: "hint" })] : [];
    part.losses.replaceChildren(create("p", summaryOf(found), { role: "status" }), list, ...hint);
  }
  /** @param {MouseEvent} event */
  function onBoard(event) {
    const frame = playerOf()?.frame;
    if (!analysis || !frame) return null;
    const scale = canvas.width / canvas.clientWidth;
    return numberAt(analysis.losses, { x: event.offsetX * scale, y: event.offsetY * scale }, canvas.width / frame.cols, scale);
  }
  /** @param {MouseEvent} event */
  function onCurve({ clientX, clientY }) {
    const { left, top } = chart.getBoundingClientRect();
    return chartMarkAt(onChart, { x: clientX - left, y: clientY - top });
  }
  /** @type {[HTMLElement, (event: MouseEvent) => number | null][]} */
  const pointed_at = [[canvas, onBoard], [chart, onCurve]];
  for (const [place, find] of pointed_at) {
    place.addEventListener("pointermove", (event) => {
      if (!analysis || event.pointerType !== "mouse") return;
      const index = find(event);
      place.style.cursor = index === null ? "" : "pointer";
      point(index);
    });
    place.addEventListener("pointerleave", () => { if (analysis) point(null); });
    place.addEventListener("click", (event) => {
      const index = analysis && find(event);
      if (index !== null) pin(index);
    });
  }
  part.ask.addEventListener("click", () => (analysis ? close() : ask()));
  return {
    /** Show the question where a person's episode has ended, and nothing of another episode. */
    paint() {
      const [{ mode }, player] = [state(), playerOf()];
      const isAsked = mode !== "watch";
      const ended = player?.frame.outcome && isAsked ? player.frame.episode : null;
      if (episode !== null && episode === ended) return;
      episode = null;
      if (analysis) show(null);
      part.losses.hidden = true;
      part.ask.hidden = ended === null || player?.frame.step === 0 || !isWhole(player?.frame);
    },
    /** Return how the player's episode compares with the one that it tries again, "" while there is nothing to compare. */
    triedText() {
      const { episode: of, move, before } = /** @type {{episode?: string, move: number, before: number | null}} */ (JSON.parse(storage.getItem(TRIED) ?? "{}"));
      const frame = playerOf()?.frame;
      return frame?.outcome && frame.episode === of ? triedText(before, frame.outcome === "explored" ? frame.step : null, move) : "";
    },
    /** Return what is to be marked on the player's board, the same object as long as it stays the same. */
    marks: () => marks,
    /** Return the player's board as it is to be shown: as before the chosen move, else as it is.
     * @param {Board} board */
    boardOf(board) {
      const index = chosen();
      return analysis && index !== null ? boardBefore(/** @type {Mars.Board} */ (board), analysis.losses[index]) : board;
    },
    /** Return what draws the numbers on the player's curve.
     * @param {{you: string, ground: string, ink: string}} colours @returns {ChartLook["over"]} */
    overChart: ({ you, ground, ink }) => (context, at) => {
      const frame = playerOf()?.frame;
      if (!analysis || !frame) return;
      onChart = placeOnCurve(analysis.losses, frame.cells, at);
      paintOnCurve(context, onChart, chosen(), { ring: you, fill: ground, ink, base_px: at.y(0) });
    },
  };
}

/** Return "low" or "high" where numbers reach that end of 0..length-1 and lie in its half alone, "" otherwise.
 * @param {number[]} numbers @param {number} length */
function endOf(numbers, length) {
  const [low, high] = [Math.min(...numbers), Math.max(...numbers)];
  if (low === 0 && high < length / 2) return "low";
  return high === length - 1 && low >= length / 2 ? "high" : "";
}

/** Return where on the map cells lie: in a corner, at an edge, or "" for anywhere else.
 * @param {Cell[]} cells @param {string[]} grid */
export function placeOf(cells, grid) {
  const up = { low: "north", high: "south", "": "" }[endOf(cells.map(([row]) => row), grid.length)];
  const across = { low: "west", high: "east", "": "" }[endOf(cells.map(([, col]) => col), grid[0].length)];
  if (up && across) return ` in the ${up}-${across} corner`;
  return up || across ? ` at the ${up || across} edge` : "";
}

/** @param {Mars.CostlyMove} loss */
function whatWasDone({ action, previous, position, grid, kind }) {
  if (kind === "ended early") return markAt(grid, cellAfter(position, action)) ? "you drove into a rock" : "you drove over the edge of the map";
  if (previous === null) return `you began by going ${action}`;
  if (action === previous) return `you went on ${action}`;
  const isBack = WAYS[previous].every((way, index) => way + WAYS[action][index] === 0);
  return `you turned ${isBack ? "back " : ""}${action}`;
}

/** @param {Mars.CostlyMove} loss */
function whatWasBetter({ step, best_action: better, missed, seen_at, grid, kind }) {
  if (kind === "ended early") return `going ${better} was free`;
  if (missed.length) {
    const seen = seen_at === null ? "which you never saw" : `which you saw only ${many(seen_at - step, "move")} later`;
    return `going ${better} would soon have shown ${many(missed.length, "unknown cell")}${placeOf(missed, grid)}, ${seen}`;
  }
  return kind === "last cells" ? `going ${better} was the shorter way to the last cells` : `going ${better} was the shorter way`;
}

/** @param {Mars.CostlyMove} loss @returns the sentence about a move; an end for good costs no number of moves */
export function sentenceOf(loss) {
  const cost = loss.kind === "ended early" ? "ended the episode" : `cost about ${many(loss.regret, "move")}`;
  return `Move ${loss.step + 1} ${cost}: ${whatWasDone(loss)}; ${whatWasBetter(loss)}.`;
}

/** Return what an episode tried again from a move came to: "80 moves before, 76 now, from move 9."
 * @param {number | null} before moves to the goal, null where it was not reached @param {number | null} now @param {number} move */
export function triedText(before, now, move) {
  const was = before === null ? "Not finished before" : `${many(before, "move")} before`;
  return `${was}, ${now ?? "not finished"} now, from move ${move}.`;
}

/** @param {Mars.Analysis} analysis @returns the sentence above the list of moves */
export function summaryOf({ policy, losses, given_up }) {
  const judged = `Judged by how ${policyName(policy)} would have finished from each move, with the whole terrain known.`;
  if (given_up > 0) return `Giving up cost ${many(given_up, "move")}: ${policyName(policy)} would have finished from there. ${judged}`;
  if (!losses.length) return `No single move cost you much. ${judged}`;
  return losses.length === 1 ? `One move cost you the most. ${judged}` : `These ${losses.length} moves cost you the most. ${judged}`;
}
