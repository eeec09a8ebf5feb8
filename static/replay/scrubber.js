// @ts-check
// The pointer on the scrubber: hovering shows a move, pressing goes there, dragging goes along.
import { plotBox, stepAt } from "./curve.js";

/**
 * @param {HTMLElement} root
 * @param {{last: () => number, onMove: (step: number) => void, onHover: (step: number | null) => void}} how
 */
export function startScrubber(root, { last, onMove, onHover }) {
  /** @param {PointerEvent} event */
  function at({ clientX }) {
    const { left, width, height } = root.getBoundingClientRect();
    return stepAt(clientX - left, plotBox(width, height), last());
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
