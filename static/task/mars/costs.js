// The end card's question: where did I lose moves? The answers stand in a list, on the board and on the chart; each can be tried again.
import { ApiError } from "../../common/api.js";
import { create, put } from "../../common/page.js";
import { TRIED } from "../../common/storage.js";
import { restOf, sentenceOf, summaryOf, triedText } from "./cost_words.js";
import { chartMarkAt, numberAt, paintOnCurve, placeOnCurve } from "./mistake_marks.js";

const ASK = "Where did I lose moves?";

/** @param {Mars.Board} board @param {Mars.Mistake} mistake @returns {Mars.Board} a board as it was known before a mistake */
export function boardBefore(board, { step, grid, position, discovered, previous }) {
  const { frame, trail } = board;
  const coverage = discovered / frame.cells;
  return { ...board, trail: trail.slice(0, step + 1), frame: { ...frame, step, grid, position, discovered, coverage, heading: previous ?? "east", outcome: null } };
}

/**
 *   tryFrom   begins the same terrain in practice and makes so many moves of the episode once more
 *   storage   of this tab: what is tried again, and what it came to before
 * @param {{part: Record<string, HTMLElement>, canvas: HTMLCanvasElement, chart: HTMLElement,
 *   state: () => GameState, load: (episode: string) => Promise<Answers.Costs>, tryFrom: (moves: number) => void,
 *   storage: Pick<Store, "read">, onChange: () => void}} how part of the player's panel, whose matrix is `canvas` */
export function createCosts({ part, canvas, chart, state, load, tryFrom, storage, onChange }) {
  const playerOf = () => /** @type {Mars.Board | null} */ (state().player);
  /** @type {string | null} the episode whose moves are shown or asked for */
  let episode = null;
  /** @type {Answers.Costs | null} */
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
    part.costs.querySelectorAll("li").forEach((item, index) => {
      item.classList.toggle("is-chosen", index === chosen());
      item.querySelector(".mistake")?.setAttribute("aria-pressed", String(index === pinned));
    });
    marks = analysis?.mistakes.length ? { mistakes: analysis.mistakes, chosen: chosen() } : null;
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
  /** @param {Answers.Costs | null} found */
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
    part.costs.hidden = true;
  }
  async function ask() {
    const player = playerOf();
    if (!player) return;
    const asked = episode = player.frame.episode;
    part.ask.hidden = true;
    part.costs.hidden = false;
    const time = player.frame.rows * player.frame.cols > 600 ? "On a board of this size that can take a minute." : "That takes a few seconds.";
    part.costs.replaceChildren(create("p", `Expert plays on from your moves. ${time}`, { role: "status" }), create("progress", [], { "aria-label": "Judging your moves" }));
    part.costs.scrollIntoView({ block: "nearest" });
    try {
      const found = await load(asked);
      if (episode !== asked) return;
      paintList(found);
      if (found.reason === null) show(found);
      part.costs.querySelector("li")?.scrollIntoView({ block: "nearest" }); // the greatest loss is in sight
    } catch (error) {
      if (episode !== asked) return;
      const reason = error instanceof ApiError ? error.message : `Something went wrong on this page: ${error}`;
      part.costs.replaceChildren(create("p", `${reason.slice(0, 1).toUpperCase()}${reason.slice(1)}.`.replace(/\.\.$/, "."), { role: "status" }));
      part.ask.hidden = error instanceof ApiError && error.status === 422;
    }
  }
  /** @param {Answers.Costs} found */
  function paintList(found) {
    const list = create("ol", found.mistakes.map((mistake, index) => {
      const choose = create("button", [create("b", String(index + 1), { "aria-hidden": "true" }), create("span", sentenceOf(mistake))],
        { type: "button", class: "mistake", "aria-pressed": "false", "data-testid": `mistake-${index + 1}` });
      const again = create("button", "Try from here", { type: "button", class: "quiet", "aria-label": `Try from here: move ${mistake.step + 1}` });
      const item = create("li", [choose, again]);
      choose.addEventListener("click", () => pin(index));
      again.addEventListener("click", () => tryFrom(mistake.step));
      item.addEventListener("pointerenter", (event) => { if (event.pointerType === "mouse") point(index); });
      item.addEventListener("pointerleave", (event) => { if (event.pointerType === "mouse") point(null); });
      item.addEventListener("focusin", () => { if (choose.matches(":focus-visible") || again.matches(":focus-visible")) point(index); });
      item.addEventListener("focusout", () => point(null));
      return item;
    }));
    const hint = found.mistakes.length ? [create("p", "Choose one: the board as you saw it, your move dashed, Expert's green with what it would soon have shown.", { class: "hint" })] : [];
    const rest = restOf(found).map((text) => create("p", text));
    part.costs.replaceChildren(create("p", summaryOf(found), { role: "status" }), ...hint, list, ...rest);
  }
  /** @param {MouseEvent} event */
  function onBoard(event) {
    const frame = playerOf()?.frame;
    if (!analysis || !frame) return null;
    const scale = canvas.width / canvas.clientWidth;
    return numberAt(analysis.mistakes, frame, { x: event.offsetX * scale, y: event.offsetY * scale }, canvas.width / frame.cols, scale);
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
  put(part.ask, ASK);
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
      part.costs.hidden = true;
      part.ask.hidden = ended === null || player?.frame.step === 0;
    },
    /** Return how the player's episode compares with the one that it tries again, "" while there is nothing to compare. */
    triedText() {
      const { episode: of, move, before } = /** @type {{episode?: string, move: number, before: number | null}} */ (storage.read(TRIED) ?? {});
      const frame = playerOf()?.frame;
      return frame?.outcome && frame.episode === of ? triedText(before, frame.outcome === "explored" ? frame.step : null, move) : "";
    },
    /** Return what is to be marked on the player's board, the same object as long as it stays the same. */
    marks: () => marks,
    /** Return the player's board as it is to be shown: as before the chosen move, else as it is.
     * @param {Board} board */
    boardOf(board) {
      const index = chosen();
      return analysis && index !== null ? boardBefore(/** @type {Mars.Board} */ (board), analysis.mistakes[index]) : board;
    },
    /** Return what draws the numbers on the player's curve.
     * @param {{you: string, ground: string, ink: string}} colours @returns {ChartLook["over"]} */
    overChart: ({ you, ground, ink }) => (context, at) => {
      const frame = playerOf()?.frame;
      if (!analysis || !frame) return;
      onChart = placeOnCurve(analysis.mistakes, frame.cells, at);
      paintOnCurve(context, onChart, chosen(), { ring: you, fill: ground, ink, base_px: at.y(0) });
    },
  };
}
