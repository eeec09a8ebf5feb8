// @ts-check
// From the state to the page: boards first, since a key press waits for them, then numbers, chart and the rest, each only where it changed.
import { paintBoard } from "../common/board.js";
import { paintChart } from "../common/chart.js";
import { ghostOf, thoughtOf } from "../common/thoughts.js";
import * as panel from "../common/panels.js";
import { emptySeat } from "../common/words.js";

/** @typedef {import("../common/game_state.js").State} State */
const SEATS = /** @type {const} */ (["player", "rival"]);

/**
 * @param {{page: Document, panels: Record<string, panel.Panel>, views: ReturnType<import("./views.js").createViews>,
 *   rivalName: () => string, showsThoughts: () => boolean, dismiss: (id: number) => void}} how
 */
export function createPainter({ page, panels, views, rivalName, showsThoughts, dismiss }) {
  const style = getComputedStyle(page.documentElement);
  const read = (/** @type {string} */ name) => style.getPropertyValue(name).trim();
  const colours = { player: read("--accent"), rival: read("--rival") };
  const chart = /** @type {HTMLCanvasElement} */ (page.getElementById("chart"));
  const legend = /** @type {HTMLElement} */ (page.getElementById("legend"));
  const notices = /** @type {HTMLElement} */ (page.getElementById("notices"));
  /** @type {State | null} */
  let painted = null;
  /** @type {{sent: number}[]} answered moves that wait for their repaint */
  let waiting = [];
  /** @type {number[]} key press to repaint of the matrix, ms, the newest thousand */
  const latencies = [];

  /**
   * @param {State} state
   * @param {State | null} before
   * @param {number} dpr
   */
  function paintBoards(state, before, dpr) {
    for (const seat of SEATS) {
      const board = state[seat];
      const { part, canvas } = panels[seat];
      const trail = ghostOf(state, seat);
      if (!board || (before && board === before[seat] && trail === ghostOf(before, seat))) continue;
      const ghost = trail && { trail, accent: colours[seat === "player" ? "rival" : "player"] };
      const thought = showsThoughts() ? thoughtOf(board) : null;
      paintBoard(canvas, board, { accent: colours[seat], ...views.size(part.matrix), dpr, ghost, thought });
    }
    const now_ms = performance.now();
    latencies.push(...waiting.map((move) => now_ms - move.sent));
    latencies.splice(0, latencies.length - 1000);
    waiting = [];
  }
  /**
   * @param {State} state
   * @param {State | null} before
   */
  function paintPanels(state, before) {
    for (const seat of SEATS) {
      if (before && state[seat] === before[seat] && state.mode === before.mode) continue;
      panel.paintPanel(panels[seat], state[seat], emptySeat(state, rivalName()));
      panel.paintPick(panels[seat], state[seat]);
      panel.paintPace(panels[seat], state[seat], seat === "rival" && !state.rival?.isReplay);
      views.load(panels[seat], state[seat]?.session ?? null);
    }
  }
  /**
   * @param {State} state
   * @param {number} dpr
   */
  function paintCurves(state, dpr) {
    const curves = SEATS.flatMap((seat) => {
      const board = state[seat];
      if (!board) return [];
      const { name, discovered, frame } = board;
      const values = showsThoughts() ? board.values : [];
      return [{ name, colour: colours[seat], isDashed: seat === "rival", discovered, cells: frame.rows * frame.cols, values }];
    });
    legend.replaceChildren(...curves.map(({ name }) => Object.assign(page.createElement("span"), { textContent: name })));
    paintChart(chart, curves, { ...views.size(/** @type {HTMLElement} */ (chart.parentElement)), dpr, font: read("--figures") });
    chart.setAttribute("aria-label", curves.map(({ name, discovered, cells }) =>
      `${name}: ${Math.floor((100 * (discovered.at(-1) ?? 0)) / cells)} percent after ${Math.max(0, discovered.length - 1)} moves`).join("; "));
  }
  return {
    /** @param {State} state */
    paint(state) {
      const before = painted;
      painted = state;
      const dpr = window.devicePixelRatio || 1;
      paintBoards(state, before, dpr);
      paintPanels(state, before);
      if (state.player !== before?.player || state.rival !== before?.rival) paintCurves(state, dpr);
      panel.paintBar(state, page);
      const hasJustEnded = panel.paintEnd(panels.player, state);
      if (hasJustEnded && !page.querySelector("dialog[open]")) panels.player.part.next.focus({ preventScroll: true });
      if (state.notices !== before?.notices) panel.paintNotices(notices, state.notices, dismiss);
    },
    /** Paints all next time: sizes changed. */
    forget() { painted = null; },
    /**
     * Moves whose answer the next repaint shows.
     * @param {{sent: number}[]} moves
     */
    answered(moves) { waiting.push(...moves); },
    latencies: () => [...latencies],
  };
}
