// From the state to the page: boards first, since a key press waits for them, then numbers, chart and the rest, each only where it changed.
import { paintLegend, paintProgress, stepsEnd } from "../common/chart.js";
import { boardColours, chartColours } from "../common/colours.js";
import { ghostOf } from "../common/game_state.js";
import { by, paintNotices, put } from "../common/page.js";
import { score } from "../common/words.js";
import { hasTwoBoards, paintBar } from "./panels.js";
import * as panel from "./panels.js";

const ROLES = /** @type {const} */ (["player", "rival"]);
/** The mark on the page's timeline at which the player's matrix was painted for the first time. */
const FIRST_FRAME = "mars.first-frame";

/** @param {{task: Task, panels: Record<string, Play.Panel>, parts: Play.Parts,
 *   sizes: ReturnType<import("../common/page.js").createSizes>,
 *   visit: Pick<ReturnType<import("./first_visit.js").createFirstVisit>, "isFirst" | "paint">, rivalName: () => string,
 *   paysBonus: (level: string) => boolean, dismiss: (id: number) => void}} how */
export function createPainter({ task, panels, sizes, visit, parts: { views, thinking, losses }, rivalName, paysBonus, dismiss }) {
  const chart = by("chart");
  /** @type {GameState | null} */
  let painted = null;
  /** @type {{pressed_ms: number}[]} answered moves that wait for their repaint */
  let waiting = [];
  /** @type {number[]} key press to repaint of the matrix, ms, the newest thousand */
  const latencies = [];

  /** @param {GameState} state @param {GameState | null} before @param {number} dpr */
  function paintBoards(state, before, dpr) {
    const { you, policy } = boardColours(document.documentElement);
    const colours = { player: you, rival: policy };
    for (const role of ROLES) {
      const board = state[role];
      const { part } = panels[role];
      const trail = ghostOf(state, role);
      if (!board || (before && board === before[role] && trail === ghostOf(before, role))) continue;
      const isMine = role === "player";
      const shown = (isMine && losses?.boardOf(board)) || board;
      const ghost = shown === board && trail ? { trail, accent: colours[isMine ? "rival" : "player"] } : null;
      task.paint(part.matrix, shown, { name: board.name, accent: colours[role], ...sizes.of(part.matrix), dpr, has_range: true, ghost,
        ...thinking?.look(state, role), marks: isMine ? losses?.marks() : null });
    }
    const now_ms = performance.now();
    if (state.player && !performance.getEntriesByName(FIRST_FRAME).length) performance.mark(FIRST_FRAME);
    latencies.push(...waiting.map((move) => now_ms - move.pressed_ms));
    latencies.splice(0, latencies.length - 1000);
    waiting = [];
  }
  /** @param {GameState} state @param {GameState | null} before */
  function paintPanels(state, before) {
    const hasTwo = hasTwoBoards(state, visit.isFirst());
    for (const role of ROLES) {
      if (before && state[role] === before[role] && state.mode === before.mode) continue;
      panel.paintPanel(panels[role], task, state[role]);
      panel.paintPick(panels[role], state[role]);
      panel.paintPace(panels[role], state[role], role === "rival" && !state.rival?.isReplay);
      views?.load(panels[role], role === "player" || hasTwo ? state[role]?.session ?? null : null);
    }
  }
  /** @param {GameState} state */
  function paintCurves(state) {
    const { inks, font, you, policy, ground } = chartColours(document.documentElement);
    const colours = { player: you, rival: policy };
    const shown = hasTwoBoards(state, visit.isFirst()) ? ROLES : /** @type {const} */ (["player"]);
    const curves = shown.flatMap((role) => {
      const board = state[role];
      return board ? [{ board, colour: colours[role], isDashed: role === "rival" }] : [];
    });
    paintLegend(by("legend"), curves.map(({ board, colour, isDashed }) =>
      ({ name: board.name, colour, dash: isDashed ? "9 4" : "" })));
    paintProgress(chart, task, curves, { font, inks, over: losses?.overChart({ you, ground, ink: inks.goal }) });
    thinking?.paint(state, { font, inks, colours, end: stepsEnd(curves.map(({ board }) => board)) });
    const label = curves.map(({ board: { name, progress } }) =>
      `${name}: ${task.chart.say(progress.at(-1) ?? 0)} after ${Math.max(0, progress.length - 1)} moves`);
    chart.setAttribute("aria-label", label.join("; ") || `${task.chart.title} over moves`);
  }
  return {
    /** Return the frame of the player's board that was painted last. */
    playersFrame: () => painted?.player?.frame ?? null,
    /** @param {GameState} state */
    paint(state) {
      const before = painted;
      painted = state;
      const dpr = window.devicePixelRatio || 1;
      document.body.dataset.boards = hasTwoBoards(state, visit.isFirst()) ? "2" : "1";
      paintBoards(state, before, dpr);
      paintPanels(state, before);
      views?.paintCamera(state.player?.frame);
      if (state.player !== before?.player || state.rival !== before?.rival) paintCurves(state);
      visit.paint(state);
      paintBar(state, rivalName());
      const hasJustEnded = paintEndCard(panels.player.part, task, state, paysBonus(state.level));
      if (hasJustEnded && !document.querySelector("dialog[open]")) panels.player.part.next.focus({ preventScroll: true });
      if (state.notices !== before?.notices) paintNotices(by("notices"), state.notices, dismiss);
    },
    /** Paint everything next time, because sizes changed. */
    forget() { painted = null; },
    /** Note moves whose answer the next repaint shows.
     * @param {{pressed_ms: number}[]} moves */
    answered(moves) { waiting.push(...moves); },
    latencies: () => [...latencies],
  };
}

/** Paint the end card of the player's board; return whether it has just appeared.
 * @param {Record<string, HTMLElement>} part of the player's panel @param {Task} task @param {GameState} state
 * @param {boolean} paysBonus whether the level pays for finishing */
function paintEndCard(part, task, { mode, player, rival }, paysBonus) {
  const frame = player?.frame;
  const wasHidden = part.end.hidden;
  part.end.hidden = !frame?.outcome;
  if (!frame || part.end.hidden) return false;
  const { title, line } = task.ending(frame);
  put(part["end-title"], title);
  put(part["end-line"], line);
  put(part["end-score"], score(frame.score));
  put(part["end-why"], mode === "watch" ? "" : task.scoreWhy(frame, paysBonus));
  const compared = task.compare(frame, rival?.frame ?? null, rival?.name ?? "", mode === "watch" ? player?.name : "You");
  put(part["end-compare"], compared);
  part["end-compare"].hidden = !compared;
  part.again.hidden = mode === "ranked"; // a terrain counts once
  /** @type {HTMLAnchorElement} */ (part["replay-link"]).href = `replay/${encodeURIComponent(frame.episode)}`;
  return wasHidden;
}
