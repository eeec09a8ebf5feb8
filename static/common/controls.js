// @ts-check
// From key presses and touches to moves: keys and on-screen arrows, each with its times.
import { hookKeys, timeOf_ms } from "./keyboard.js";

/** Return the timing of one press. A script's press, or one in a driven browser, is never called a key or a touch.
 * @param {"key" | "touch"} input @param {{isTrusted: boolean}} event @param {boolean} isDriven
 * @param {number} down_ms @param {number | null} up_ms release of the press before, if known @param {number} now_ms
 * @returns {Timing} */
export function timing(input, event, isDriven, down_ms, up_ms, now_ms) {
  return { input: event.isTrusted && !isDriven ? input : null, key_down_ms: round(down_ms), key_up_ms: up_ms === null ? null : round(up_ms),
    client_ms: round(now_ms) };
}
/** @param {number} ms */
const round = (ms) => Math.round(ms * 10) / 10;

/** Start the controls, and return how another gesture presses.
 *   onAct    a press, its time, and what is held until `onLetGo` names it: a key's code or a button's
 *   onLetGo  what came up; null where all counts as let go
 * @param {{page: Window & typeof globalThis, frames: HTMLIFrameElement[], pad: HTMLElement, onAct: (action: Action,
 *   timing: Timing, pressedAt_ms: number, holder: string) => void, onEnter: (event: KeyboardEvent) => boolean,
 *   actionOf: (code: string) => Action | undefined, onLetGo?: (holder: string | null) => void}} how */
export function startControls({ page, frames, pad, onAct, onEnter, actionOf, onLetGo }) {
  /** @type {number | null} */
  let up_ms = null;
  const isDriven = () => page.navigator.webdriver === true;
  /** @param {"key" | "touch"} input @param {Action} action @param {globalThis.Event} event @param {number} at_ms
   * @param {string} holder */
  function press(input, action, event, at_ms, holder) {
    const previous_ms = up_ms;
    up_ms = null;
    onAct(action, timing(input, event, isDriven(), at_ms, previous_ms, page.performance.now()), at_ms, holder);
  }
  /** @param {string} holder @param {number} at_ms */
  function release(holder, at_ms) {
    up_ms = at_ms;
    onLetGo?.(holder);
  }
  const handlers = {
    /** @param {Action} action @param {KeyboardEvent} event @param {number} at_ms */
    onPress: (action, event, at_ms) => press("key", action, event, at_ms, event.code),
    /** @param {number} at_ms */
    onRelease: (at_ms) => { up_ms = at_ms; },
    onEnter,
    actionOf,
    onLetGo,
  };
  hookKeys(page, handlers, page);
  for (const frame of frames) {
    frame.addEventListener("load", () => frame.contentWindow && hookKeys(/** @type {Window & typeof globalThis} */ (frame.contentWindow), handlers, page));
  }
  for (const kind of /** @type {const} */ (["pointerdown", "pointerup", "pointercancel", "pointerout", "click", "contextmenu"])) {
    pad.addEventListener(kind, (event) => touch(kind, /** @type {PointerEvent} */ (event)));
  }
  /** @param {string} kind @param {PointerEvent} event on the pad, whose buttons may change */
  function touch(kind, event) {
    const button = /** @type {HTMLElement | null} */ (/** @type {Element} */ (event.target).closest("[data-action]"));
    if (!button) return;
    const [action, at_ms] = [button.dataset.action ?? "", timeOf_ms(event, page, page)];
    const holder = `button ${action}`;
    if (kind === "contextmenu") event.preventDefault();
    else if (kind === "click") {
      if (event.detail !== 0) return; // a click without a pointer comes from a keyboard or an assistive tool
      press("touch", action, event, at_ms, holder);
      onLetGo?.(holder);
    } else if (kind === "pointerdown") {
      if (!event.isPrimary || event.button !== 0) return;
      event.preventDefault();
      button.classList.add("is-down");
      press("touch", action, event, at_ms, holder);
    } else if (kind !== "pointerout" || !button.contains(/** @type {Node | null} */ (event.relatedTarget))) {
      if (button.classList.contains("is-down")) release(holder, at_ms);
      button.classList.remove("is-down");
    }
  }
  return { press, release };
}
