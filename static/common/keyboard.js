// @ts-check
// Keys that drive wherever the focus is: the page and the 3-D view inside it. No document here, so node can test every rule.

/** @param {Keys} keys @param {string} code @returns {Action | undefined} what a key does, or undefined */
export const actionOf = (keys, code) => Object.keys(keys).find((action) => keys[action].includes(code));

const BUTTON_LIKE = /^(button|submit|reset|checkbox|image|file|color)$/;

/** Return whether arrows and letters belong to the element: fields, sliders, tabs, an open dialog.
 * @param {{tagName?: string, type?: string, isContentEditable?: boolean, closest?: (selector: string) => unknown} |
 *   null} element */
export function ownsKeys(element) {
  if (!element) return false;
  if (element.isContentEditable) return true;
  const tag = element.tagName ?? "";
  if (/^(TEXTAREA|SELECT)$/.test(tag)) return true;
  if (tag === "INPUT" && !BUTTON_LIKE.test(element.type ?? "text")) return true;
  return Boolean(element.closest?.("[role=slider],[role=tab],dialog[open]"));
}

/** @param {globalThis.Event} event @returns the element at which an event started, also inside a shadow tree */
export function keyOrigin(event) {
  return /** @type {HTMLElement | null} */ (event.composedPath?.()[0] ?? event.target);
}

/** A browser's time of an event that is older than this is not believed: some count from the start of the machine. */
const OLDEST_MS = 10_000;
/** @type {WeakMap<globalThis.Event, number>} */
const times_ms = new WeakMap();

/** Return when an event happened, in ms of the page's own clock: never later than now, and the same whoever asks, so
 * that an input event and the move that it causes have one time.
 * @param {globalThis.Event} event
 * @param {Window & typeof globalThis} view whose event it is: the page or a frame in it
 * @param {Window & typeof globalThis} page */
export function timeOf_ms(event, view, page) {
  const known_ms = times_ms.get(event);
  if (known_ms !== undefined) return known_ms;
  const at_ms = event.timeStamp + (view.performance.timeOrigin - page.performance.timeOrigin);
  const now_ms = page.performance.now();
  const time_ms = at_ms <= now_ms && at_ms > now_ms - OLDEST_MS ? at_ms : now_ms;
  times_ms.set(event, time_ms);
  return time_ms;
}

/** Handle a window's keys before any other listener.
 *   onPress    a drive key went down (auto-repeat is swallowed): its action, its event and the time in the page's own
 *   ms
 *   onRelease  it came up again
 *   onEnter    Enter outside fields; true when it was used
 *   onLetGo    any key came up, wherever the focus was: its code; null when all count as let go, because the window
 *   lost the focus
 *              or a chord began, after which some systems report no key that comes up
 *   actionOf   the action of a key's code; undefined lets the key pass
 * @param {Window & typeof globalThis} view
 * @param {{onPress: (action: Action, event: KeyboardEvent, at_ms: number) => void, onRelease: (at_ms: number) => void,
 *   onEnter: (event: KeyboardEvent) => boolean, actionOf: (code: string) => Action | undefined,
 *   onLetGo?: (code: string | null) => void}} handlers
 * @param {Window & typeof globalThis} page with the clock that counts */
export function hookKeys(view, handlers, page) {
  /** @param {KeyboardEvent} event */
  const at_ms = (event) => timeOf_ms(event, view, page);
  /** @param {KeyboardEvent} event */
  function handle(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) handlers.onLetGo?.(null);
    else if (event.type === "keyup") handlers.onLetGo?.(event.code);
    if (event.ctrlKey || event.metaKey || event.altKey || event.isComposing || ownsKeys(keyOrigin(event))) return;
    if (event.key === "Enter" && event.type === "keydown" && !event.repeat) {
      if (handlers.onEnter(event)) swallow(event);
      return;
    }
    const action = handlers.actionOf(event.code);
    if (!action) return;
    swallow(event);
    if (event.type === "keyup") handlers.onRelease(at_ms(event));
    else if (!event.repeat) handlers.onPress(action, event, at_ms(event));
  }
  view.addEventListener("keydown", handle, true);
  view.addEventListener("keyup", handle, true);
  if (handlers.onLetGo) view.addEventListener("blur", (event) => event.target === view && handlers.onLetGo?.(null));
}

/** @param {KeyboardEvent} event */
function swallow(event) {
  event.preventDefault();
  event.stopImmediatePropagation();
}
