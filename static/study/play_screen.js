// @ts-check
// The screen on which the rover is driven: the board first, since a key press waits for it, then numbers, curve, coach, pause and end card.
import { paintBoard } from "../common/board.js";
import { paintCoverage } from "../common/chart.js";
import { elementsOf, put } from "../common/page.js";
import { describeBoard, outcomeShort, percent, score } from "../common/words.js";
import { knowsTheEnd, screenOf } from "./state.js";
import * as words from "./words.js";

/** @param {Document} page @param {{look: () => Study.Look, keys: () => {east: string, south: string}}} how */
export function createPlayScreen(page, { look, keys }) {
  const by = elementsOf(page);
  const dpr = () => page.defaultView?.devicePixelRatio || 1;
  const room = (/** @type {HTMLElement} */ element) => ({ width_px: element.clientWidth, height_px: element.clientHeight });

  /** @param {Board} board @param {Study.Look} colours */
  function paintCurve(board, { accent, inks, font }) {
    paintCoverage(by("chart"), [{ board, colour: accent }], { font, inks });
  }
  /** @param {Frame} frame @param {Study.Participant} participant */
  function paintNumbers(frame, { phase, rules }) {
    put(by("moves"), String(frame.step));
    put(by("coverage"), percent(frame.coverage));
    put(by("outcome"), outcomeShort(frame.outcome));
    by("score-row").hidden = frame.score === null;
    put(by("score"), score(frame.score));
    by("hidden-score").hidden = frame.score !== null;
    by("coach").hidden = phase !== "tutorial" || frame.outcome !== null;
    by("skip").hidden = phase !== "tutorial" || frame.outcome !== null;
    by("open-give-up").hidden = phase === "tutorial" || frame.outcome !== null;
    const [title, line] = words.coach(frame, keys(), rules.coverage);
    put(by("coach-title"), title);
    put(by("coach-line"), line);
    by("board").setAttribute("aria-label", describeBoard(frame, "the terrain"));
  }
  /** @param {Study.State} state @returns {boolean} whether the card has just come up */
  function paintEnd(state) {
    const frame = state.game.player?.frame;
    const { participant } = state;
    const card = by("end");
    const wasHidden = card.hidden;
    card.hidden = !participant || !frame?.outcome;
    if (!participant || !frame?.outcome) return false;
    const { title, line, figures, note, go } = words.endCard(frame, participant);
    put(by("end-title"), title);
    put(by("end-line"), line);
    by("end-figures").replaceChildren(...figures.map(([name, value]) => {
      const row = page.createElement("div");
      row.append(Object.assign(page.createElement("dt"), { textContent: name }), Object.assign(page.createElement("dd"), { textContent: value }));
      return row;
    }));
    const isKnown = knowsTheEnd(state);
    put(by("end-note"), isKnown ? note : "");
    put(by("next-text"), isKnown ? go : "One moment");
    by("next").setAttribute("aria-disabled", String(!isKnown));
    by("again").hidden = participant.phase !== "tutorial" || !isKnown;
    return wasHidden;
  }
  return {
    /** @param {Study.State} state @param {Study.State | null} before */
    paint(state, before) {
      const { game, participant, isPaused } = state;
      const { player } = game;
      page.body.dataset.paused = String(isPaused);
      if (screenOf(state) !== "play" || !player || !participant) return;
      const isNew = before === null || screenOf(before) !== "play";
      if (isNew || player !== before.game.player) paintBoard(by("board", HTMLCanvasElement), player, { ...look(), ...room(by("matrix")), dpr: dpr() });
      if (isNew || player !== before.game.player || participant !== before.participant) {
        paintNumbers(player.frame, participant);
        paintCurve(player, look());
        page.body.dataset.ended = String(player.frame.outcome !== null);
        page.body.dataset.phase = participant.phase ?? "";
      }
      const pause = by("pause");
      if (pause.hidden === isPaused) {
        pause.hidden = !isPaused;
        if (isPaused) by("resume").focus({ preventScroll: true });
        else by("field").focus({ preventScroll: true });
      }
      const hadFocus = by("end").contains(page.activeElement);
      if (paintEnd(state)) {
        if (!page.querySelector("dialog[open]")) by("next").focus({ preventScroll: true });
      } else if (hadFocus && by("end").hidden) by("field").focus({ preventScroll: true });
    },
  };
}
