// @ts-check
// Swipes on the board: one swipe is one move, and a finger that stays down holds it as a key is held. No document in the rules, so
// node can test them.

/** A finger that went so far has swiped. */
export const SWIPE_PX = 22;
/** So many times further along one axis than along the other: what is more diagonal waits until it is clear. */
const CLEAR = 1.25;

/** Return the arrow key that a finger's way stands for, or null while that is not clear.
 * @param {number} right_px @param {number} down_px */
export function directionOf(right_px, down_px) {
  const [across, along] = [Math.abs(right_px), Math.abs(down_px)];
  if (Math.max(across, along) < SWIPE_PX) return null;
  if (across > along * CLEAR) return right_px > 0 ? "ArrowRight" : "ArrowLeft";
  if (along > across * CLEAR) return down_px > 0 ? "ArrowDown" : "ArrowUp";
  return null;
}

/** Return what follows the fingers on one surface.
 *   isOn     whether swipes drive now
 *   actionOf  what an arrow key does
 *   onSwipe  a swipe, with the event that made it clear
 *   onEnd    the finger that swiped came up
 * @param {{isOn: () => boolean, actionOf: (code: string) => Action | undefined,
 *   onSwipe: (action: Action, event: PointerEvent) => void, onEnd: (action: Action,
 *   event: PointerEvent) => void}} how */
export function createSwipe({ isOn, actionOf, onSwipe, onEnd }) {
  /** The first finger; `isOver` once it has swiped, or a second one has joined it.
   * @type {{id: number, x: number, y: number, action: Action | null, isOver: boolean} | null} */
  let finger = null;
  /** Take a pointer event; return whether it belongs to a swipe, so that nothing else is to be done with it.
   * @param {PointerEvent} event */
  return function take(event) {
    if (event.pointerType === "mouse") return false;
    if (event.type === "pointerdown") {
      if (!isOn()) return false;
      if (event.isPrimary) finger = { id: event.pointerId, x: event.clientX, y: event.clientY, action: null, isOver: false };
      else if (finger) finger.isOver = true; // two fingers swipe nothing, and zoom nothing either
      return true;
    }
    if (event.pointerId !== finger?.id) return finger !== null;
    if (event.type === "pointermove") {
      const code = finger.isOver ? null : directionOf(event.clientX - finger.x, event.clientY - finger.y);
      const action = code && actionOf(code);
      if (!action) return true;
      Object.assign(finger, { action, isOver: true });
      onSwipe(action, event);
      return true;
    }
    const { action } = finger;
    finger = null;
    if (action) onEnd(action, event);
    return true;
  };
}

const TYPES = /** @type {const} */ (["pointerdown", "pointermove", "pointerup", "pointercancel"]);

/** Follow the swipes on elements of the page and inside frames on it, before any other listener.
 *   onSwipe, onEnd  as of `createSwipe`, with the window in which the event happened
 * @param {{page: Window & typeof globalThis, surfaces: HTMLElement[], frames: HTMLIFrameElement[], isOn: () => boolean,
 *   actionOf: (code: string) => Action | undefined, onSwipe: (action: Action, event: PointerEvent, view: Window & typeof globalThis) => void, onEnd: (action: Action,
 *   event: PointerEvent, view: Window & typeof globalThis) => void}} how */
export function startSwipes({ page, surfaces, frames, isOn, actionOf, onSwipe, onEnd }) {
  /** @param {HTMLElement | (Window & typeof globalThis)} target @param {Window & typeof globalThis} view */
  function follow(target, view) {
    const take = createSwipe({ isOn, actionOf, onSwipe: (action, event) => onSwipe(action, event, view), onEnd: (action, event) => onEnd(action, event, view) });
    for (const type of TYPES) {
      target.addEventListener(type, (event) => {
        if (!take(/** @type {PointerEvent} */ (event))) return;
        event.stopImmediatePropagation();
        if (event.cancelable) event.preventDefault();
      }, true);
    }
    // a finger that stays down must not bring up a menu
    target.addEventListener("contextmenu", (event) => { if (isOn() && /** @type {PointerEvent} */ (event).pointerType !== "mouse") event.preventDefault(); }, true);
  }
  for (const surface of surfaces) follow(surface, page);
  for (const frame of frames) {
    frame.addEventListener("load", () => frame.contentWindow && follow(/** @type {Window & typeof globalThis} */ (frame.contentWindow),
      /** @type {Window & typeof globalThis} */ (frame.contentWindow)));
  }
}
