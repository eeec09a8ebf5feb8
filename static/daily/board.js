// @ts-check
// The board of the daily page: one panel from its HTML, painted from the state.
import { boardColours } from "../common/colours.js";
import { createSizes, elementsOf, paintLink, paintNotices, partsOf, put } from "../common/page.js";
import { promptText } from "../play/first_visit.js";
import { paintNumbers } from "../play/panels.js";

/** @param {Document} page
 * @param {{task: Task, createViews?: typeof import("../task/mars/views.js").createViews, onChange: () => void,
 *   dismiss: (id: number) => void}} how onChange: sizes or the way of drawing have changed */
export function createBoard(page, { task, createViews, onChange, dismiss }) {
  const by = elementsOf(page);
  const root = by("board");
  const part = partsOf(root);
  const canvas = /** @type {HTMLCanvasElement} */ (part.canvas);
  const viewer = /** @type {HTMLIFrameElement} */ (part.viewer);
  const panel = { role: /** @type {const} */ ("player"), root, part, canvas, viewer };
  const views = createViews?.({ page, panels: [panel], storage: localStorage, onChange });
  const sizes = createSizes(onChange);
  sizes.watch(part.matrix);
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
      views?.showMatrixOnly(!board?.session);
      if (!board) return;
      const { frame } = board;
      task.paint(part.matrix, board, { name: "You", accent: boardColours(page.documentElement).you, ...sizes.of(part.matrix), dpr: window.devicePixelRatio || 1 });
      paintNumbers(root, part, task, frame);
      page.body.dataset.ended = String(Boolean(frame.outcome));
      page.body.dataset.state = frame.outcome ? "ended" : frame.step ? "running" : "fresh";
      by("prompt").hidden = frame.step > 0 || Boolean(frame.outcome);
      views?.load(panel, board.session || null);
      views?.paintCamera(frame);
      painted = board;
    },
  };
}
