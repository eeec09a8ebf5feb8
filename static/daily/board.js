// @ts-check
// The board of the daily page: one panel from its HTML, painted from the state.
import { paintBoard } from "../common/board.js";
import { boardColours } from "../common/colours.js";
import { elementsOf, paintLink, paintNotices, put } from "../common/page.js";
import { describeBoard, percent } from "../common/words.js";
import { createViews } from "../play/views.js";
import { outcomeWord, promptText } from "../play/words.js";

/** @param {Document} page
 * @param {{onChange: () => void, dismiss: (id: number) => void}} how onChange: sizes or the way of drawing have changed
 */
export function createBoard(page, { onChange, dismiss }) {
  const by = elementsOf(page);
  const root = by("board");
  /** @type {Record<string, HTMLElement>} */
  const part = {};
  for (const element of /** @type {NodeListOf<HTMLElement>} */ (root.querySelectorAll("[data-part]"))) part[element.dataset.part ?? ""] = element;
  const canvas = /** @type {HTMLCanvasElement} */ (part.canvas);
  const viewer = /** @type {HTMLIFrameElement} */ (part.viewer);
  const panel = { role: /** @type {const} */ ("player"), root, part, canvas, viewer };
  const views = createViews({ page, panels: [panel], storage: localStorage, onChange });
  views.watch(part.matrix);
  put(by("prompt-text"), promptText(matchMedia("(pointer: coarse)").matches));
  /** @type {GameState["player"]} */
  let painted = null;
  return {
    root,
    viewer,
    painted: () => painted?.frame ?? null,
    /** @param {GameState} state */
    paint(state) {
      const board = state.player;
      paintLink(by("link"), state.link, "live");
      paintNotices(by("notices"), state.notices, dismiss);
      views.showMatrixOnly(!board?.session);
      if (!board) return;
      const { frame } = board;
      paintBoard(canvas, board, { accent: boardColours(page.documentElement).you, ...views.size(part.matrix), dpr: window.devicePixelRatio || 1 });
      put(part.steps, String(frame.step));
      put(part["steps-name"], frame.step === 1 ? "move" : "moves");
      put(part.coverage, percent(frame.coverage));
      put(part.outcome, outcomeWord(frame.outcome));
      root.style.setProperty("--share", String(frame.coverage));
      root.dataset.outcome = frame.outcome ?? "running";
      canvas.setAttribute("aria-label", describeBoard(frame, "You"));
      page.body.dataset.ended = String(Boolean(frame.outcome));
      page.body.dataset.state = frame.outcome ? "ended" : frame.step ? "running" : "fresh";
      by("prompt").hidden = frame.step > 0 || Boolean(frame.outcome);
      views.load(panel, board.session || null);
      views.paintCamera(frame);
      painted = board;
    },
  };
}
