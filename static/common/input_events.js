// @ts-check
// What the pages record of their user besides moves: every driving key and touch, focus, visibility.
import { keyOrigin, ownsKeys, timeOf_ms } from "./keyboard.js";

/** Record raw events before any other listener can stop them; call this before the controls are started.
 *   frames      in which keys drive as well, such as the 3-D views
 *   note        keeps an event
 *   flush       sends what is kept; `leave` does it when the page may never come back
 *   drives      whether a key's code drives the rover now
 *   onActivity  anything was pressed: the user is there
 * @param {{page: Window & typeof globalThis, frames: HTMLIFrameElement[], pad: HTMLElement,
 *   note: (kind: RecordedEvent["kind"], fields?: object) => void, flush: () => void, leave: () => void,
 *   drives: (code: string) => boolean, onActivity: () => void}} how */
export function recordInputEvents({ page, frames, pad, note, flush, leave, drives, onActivity }) {
  /** @param {Window & typeof globalThis} view */
  function recordKeys(view) {
    for (const kind of /** @type {const} */ (["keydown", "keyup"])) {
      view.addEventListener(kind, (event) => {
        if (kind === "keydown") onActivity();
        if (!drives(event.code) || ownsKeys(keyOrigin(event))) return;
        note(kind, { code: event.code, repeat: event.repeat, trusted: event.isTrusted, at_ms: timeOf_ms(event, view, page) });
      }, true);
    }
  }
  recordKeys(page);
  for (const frame of frames) {
    frame.addEventListener("load", () => frame.contentWindow && recordKeys(/** @type {Window & typeof globalThis} */ (frame.contentWindow)));
  }
  page.addEventListener("pointerdown", onActivity, true);
  /** @param {RecordedEvent["kind"]} kind @param {MouseEvent} event */
  function noteTouch(kind, event) {
    const code = /** @type {HTMLElement | null} */ (/** @type {Element} */ (event.target).closest("[data-action]"))?.dataset.action;
    if (code) note(kind, { code, repeat: false, trusted: event.isTrusted, at_ms: timeOf_ms(event, page, page) });
  }
  for (const [type, kind] of /** @type {const} */ ([["pointerdown", "touchdown"], ["pointerup", "touchup"], ["pointercancel", "touchup"]])) {
    pad.addEventListener(type, (event) => noteTouch(kind, event), true);
  }
  // A click without a pointer comes from a keyboard or an assistive tool, and is down and up at once.
  pad.addEventListener("click", (event) => {
    if (event.detail !== 0) return;
    noteTouch("touchdown", event);
    noteTouch("touchup", event);
  }, true);
  page.addEventListener("focus", () => note("focus"));
  page.addEventListener("blur", () => note("blur"));
  page.document.addEventListener("visibilitychange", () => {
    note(page.document.hidden ? "hidden" : "visible");
    if (page.document.hidden) leave();
    else flush();
  });
  page.addEventListener("pagehide", leave);
}
