// @ts-check
// What the page records of its user besides moves: every driving key and touch, focus, visibility.

/** @typedef {import("./telemetry.js").InputEvent} InputEvent */

/**
 * Record raw events before any other listener can stop them; call this before the controls are started.
 *   note        keeps an event
 *   flush       sends what is kept; `leave` does it when the page may never come back
 *   drives      whether a key's code drives the rover now
 *   onActivity  anything was pressed: the user is there
 * @param {{page: Window & typeof globalThis, pad: HTMLElement, note: (kind: InputEvent["kind"], fields?: object) => void, flush: () => void, leave: () => void,
 *   drives: (code: string) => boolean, onActivity: () => void}} how
 */
export function recordInputEvents({ page, pad, note, flush, leave, drives, onActivity }) {
  for (const kind of /** @type {const} */ (["keydown", "keyup"])) {
    page.addEventListener(kind, (event) => {
      if (kind === "keydown") onActivity();
      if (drives(event.code)) note(kind, { code: event.code, repeat: event.repeat, trusted: event.isTrusted, at_ms: event.timeStamp });
    }, true);
  }
  page.addEventListener("pointerdown", onActivity, true);
  for (const [type, kind] of /** @type {const} */ ([["pointerdown", "touchdown"], ["pointerup", "touchup"], ["pointercancel", "touchup"]])) {
    pad.addEventListener(type, (event) => {
      const code = /** @type {HTMLElement | null} */ (/** @type {Element} */ (event.target).closest("[data-action]"))?.dataset.action;
      if (code) note(kind, { code, repeat: false, trusted: event.isTrusted, at_ms: event.timeStamp });
    }, true);
  }
  page.addEventListener("focus", () => note("focus"));
  page.addEventListener("blur", () => note("blur"));
  page.document.addEventListener("visibilitychange", () => {
    note(page.document.hidden ? "hidden" : "visible");
    if (page.document.hidden) leave();
    else flush();
  });
  page.addEventListener("pagehide", leave);
}
