// The scrubber: how far both runs have come over moves, bright as far as the replay has come, and the pointer on it.
import { drawDot, paintChart } from "../common/chart.js";
import { movesAxis } from "../common/chart_scale.js";
import { chartColours } from "../common/page.js";

const EDGES = { left: 44, right: 14, top: 10, bottom: 24 };

/** @param {number} x_px in the picture @param {number} width_px of the picture @param {number} last
 * @returns the move at a place of the picture: the nearest one, the first or last outside the plot */
export function stepAt(x_px, width_px, last) {
  const share = (x_px - EDGES.left) / Math.max(1, width_px - EDGES.right - EDGES.left);
  return Math.max(0, Math.min(last, Math.round(last * share)));
}

/** @param {HTMLElement} place @param {Task} task @param {{course: Course, colour: string, isDashed: boolean}[]} runs the
 * episode's own first @param {{step: number, last: number}} where */
export function paintCurve(place, task, runs, { step, last }) {
  const { inks, font } = chartColours(place);
  const { goal, axis } = task.chart;
  const curves = [...runs].reverse().map((run) => ({ ...run, y: Array.from({ length: run.course.actions.length + 1 }, (_, move) => task.progressAt(run.course, move)) }));
  const lines = curves.flatMap(({ course, colour, isDashed, y }) => {
    const [x, dash, done] = [[...y.keys()], isDashed ? [6, 4] : [], Math.min(step, course.actions.length) + 1];
    const bright = { colour, dash, width: 3, x: x.slice(0, done), y: y.slice(0, done) };
    return [{ colour, dash, alpha: 0.42, dot: 2.5, x, y }, bright];
  });
  paintChart(place, {
    lines, inks, font, goal, edges: EDGES, x: movesAxis(last), y: axis(place.clientHeight, curves.flatMap(({ y }) => y)),
    over(context, at) {
      context.fillStyle = inks.goal;
      context.fillRect(at.x(step) - 0.75, EDGES.top - 6, 1.5, place.clientHeight - EDGES.top - EDGES.bottom + 6);
      for (const { course: { actions }, colour, y } of curves) {
        const move = Math.min(step, actions.length);
        drawDot(context, { x: at.x(move), y: at.y(y[move]) }, 4.5, colour);
      }
    },
  });
}

/** Let the pointer go through a replay: hovering shows a move, pressing goes there, dragging goes along.
 * @param {HTMLElement} root
 * @param {{last: () => number, onMove: (step: number) => void, onHover: (step: number | null) => void}} how */
export function startScrubber(root, { last, onMove, onHover }) {
  /** @param {PointerEvent} event */
  function at({ clientX }) {
    const { left, width } = root.getBoundingClientRect();
    return stepAt(clientX - left, width, last());
  }
  let isDragged = false;
  root.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    isDragged = true;
    root.setPointerCapture(event.pointerId);
    root.focus({ preventScroll: true });
    onMove(at(event));
  });
  root.addEventListener("pointermove", (event) => {
    if (isDragged) onMove(at(event));
    else if (event.pointerType === "mouse") onHover(at(event));
  });
  const drop = () => { isDragged = false; };
  root.addEventListener("pointerup", drop);
  root.addEventListener("pointercancel", drop);
  root.addEventListener("pointerleave", () => { if (!isDragged) onHover(null); });
}
