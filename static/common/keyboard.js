// Keys that drive wherever the focus is: the page and the 3-D view inside it. No document here, so node can test every rule.

/** @param {Keys} keys @param {string} code @returns {Action | undefined} what a key does, or undefined */
export const actionOf = (keys, code) => Object.keys(keys).find((action) => keys[action].includes(code));

/** @param {Keys} keys @param {string} code @returns {Action | undefined} an action that a key helps to cause: its own, or of a combination */
export const partOf = (keys, code) => actionOf(keys, code) ?? Object.keys(keys).find((action) => keys[action].some((each) => each.split("+").includes(code)));

/** What keyboards, remote controls and assistive tools call the arrows where no code says which key it is. */
const ARROWS = /^(?:Arrow|UIKeyInput)?(Up|Right|Down|Left)(?:Arrow)?$/;
/** The arrows that are printed on a number pad. */
const ON_PAD = Object.freeze({ Numpad8: "ArrowUp", Numpad6: "ArrowRight", Numpad2: "ArrowDown", Numpad4: "ArrowLeft" });
/** The arrows by the number that old tools send alone. */
const BY_NUMBER = Object.freeze({ 37: "ArrowLeft", 38: "ArrowUp", 39: "ArrowRight", 40: "ArrowDown" });

/** @param {string} key of an event @returns {string | undefined} the code of the key on which it stands */
function codeOfKey(key) {
  const [, toward] = ARROWS.exec(key) ?? [];
  if (toward) return `Arrow${toward}`;
  if (/^[a-z]$/i.test(key)) return `Key${key.toUpperCase()}`;
  if (/^\d$/.test(key)) return `Digit${key}`;
  return key === " " || key === "Spacebar" ? "Space" : /^[A-Z][A-Za-z]+$/.test(key) && key !== "Unidentified" ? key : undefined;
}

/** Return the codes that a key may stand for, the likeliest first: its own, else the one that its meaning names. Android's
 * keyboards, remote controls and some assistive tools send no code.
 * @param {Pick<KeyboardEvent, "code" | "key" | "keyCode">} event @returns {string[]} */
export function codesOf({ code, key, keyCode }) {
  const isNamed = Boolean(code) && code !== "Unidentified";
  const meant = codeOfKey(key ?? "") ?? /** @type {Record<number, string>} */ (BY_NUMBER)[keyCode];
  const codes = isNamed ? [code, meant?.startsWith("Arrow") ? meant : "", /** @type {Record<string, string>} */ (ON_PAD)[code]] : [meant];
  return codes.filter(Boolean);
}

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
export const keyOrigin = (event) => /** @type {HTMLElement | null} */ (event.composedPath?.()[0] ?? event.target);

/** A browser's time of an event that is older than this is not believed: some count from the start of the machine. */
const OLDEST_MS = 10_000;
/** @type {WeakMap<globalThis.Event, number>} */
const times_ms = new WeakMap();

/** Return when an event happened, in ms of the page's own clock: never later than now, and the same whoever asks, so that an
 * input event and the move that it causes have one time.
 * @param {globalThis.Event} event @param {View} view whose event it is: the page or a frame in it
 * @param {View} page */
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
 *   onPress    a drive key went down (auto-repeat is swallowed), at a time of the page's own
 *   onRelease  it came up again
 *   onEnter    Enter outside fields; true when it was used
 *   onLetGo    any key came up, wherever the focus was: its code; null when the window lost the focus or a chord
 *              began, after which some systems report no key that comes up
 *   codeOf     the code by which a key drives; undefined where it does not
 *   actionOf   the action of such a code; undefined lets the key pass
 *   onEvent    any key went down or came up, whatever becomes of it; `isOwn` where it belongs to what has the focus
 * @param {View} view
 * @param {{onPress: (action: Action, event: KeyboardEvent, at_ms: number, code: string) => void,
 *   onRelease: (at_ms: number) => void, onEnter: (event: KeyboardEvent) => boolean,
 *   codeOf: (event: KeyboardEvent) => string | undefined, actionOf: (code: string) => Action | undefined,
 *   onLetGo?: (code: string | null) => void,
 *   onEvent?: (event: KeyboardEvent, code: string | undefined, isOwn: boolean, at_ms: number) => void}} handlers
 * @param {View} page with the clock that counts */
export function hookKeys(view, handlers, page) {
  /** @param {KeyboardEvent} event */
  const at_ms = (event) => timeOf_ms(event, view, page);
  /** @param {KeyboardEvent} event */
  function handle(event) {
    const isOwn = ownsKeys(keyOrigin(event));
    const code = handlers.codeOf(event);
    handlers.onEvent?.(event, code, isOwn, at_ms(event));
    if (event.ctrlKey || event.metaKey || event.altKey) handlers.onLetGo?.(null);
    else if (event.type === "keyup") handlers.onLetGo?.(code ?? event.code);
    if (event.ctrlKey || event.metaKey || event.altKey || event.isComposing || isOwn) return;
    if (event.key === "Enter" && event.type === "keydown" && !event.repeat) {
      if (handlers.onEnter(event)) swallow(event);
      return;
    }
    const action = code && handlers.actionOf(code);
    if (!code || !action) return;
    swallow(event);
    if (event.type === "keyup") handlers.onRelease(at_ms(event));
    else if (!event.repeat) handlers.onPress(action, event, at_ms(event), code);
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

/** Return the timing of one press. A script's press, or one in a driven browser, is never called a key or a touch.
 * @param {"key" | "touch"} input @param {{isTrusted: boolean}} event @param {boolean} isDriven @param {number} down_ms
 * @param {number | null} up_ms release of the press before, if known @param {number} now_ms @returns {Timing} */
export function timing(input, event, isDriven, down_ms, up_ms, now_ms) {
  return { input: event.isTrusted && !isDriven ? input : null, key_down_ms: round(down_ms), key_up_ms: up_ms === null ? null : round(up_ms),
    client_ms: round(now_ms) };
}
/** @param {number} ms */
const round = (ms) => Math.round(ms * 10) / 10;

/** Start the controls, and return how another gesture presses. Raw events are noted before anything is made of them.
 *   frames   in which keys drive as well, such as the 3-D views
 *   pad      whose buttons may change
 *   codeOf   the code by which a key is noted; undefined where it does not drive
 *   onAct    a press, its time, and what is held until `onLetGo` names it: a key's code or a button's
 *   onLetGo  what came up; null where all counts as let go
 * @param {{frames: HTMLIFrameElement[], pad: HTMLElement, telemetry: Pick<Telemetry, "note" | "look" | "flush" | "leave">,
 *   codeOf: (event: KeyboardEvent) => string | undefined, onActivity?: () => void, onAct: (action: Action, timing: Timing,
 *   pressedAt_ms: number, holder: string) => void, onEnter: (event: KeyboardEvent) => boolean,
 *   actionOf: (code: string) => Action | undefined, onLetGo?: (holder: string | null) => void}} how */
export function startControls({ frames, pad, telemetry: { note, look, flush, leave }, codeOf, onActivity, onAct, onEnter, actionOf, onLetGo }) {
  /** @type {number | null} */
  let up_ms = null;
  /** @param {"key" | "touch"} input @param {Action} action @param {globalThis.Event} event @param {number} at_ms
   * @param {string} holder */
  function press(input, action, event, at_ms, holder) {
    const previous_ms = up_ms;
    up_ms = null;
    onAct(action, timing(input, event, navigator.webdriver === true, at_ms, previous_ms, performance.now()), at_ms, holder);
  }
  /** @param {string} holder @param {number} at_ms */
  function release(holder, at_ms) {
    up_ms = at_ms;
    onLetGo?.(holder);
  }
  /** @type {Parameters<typeof hookKeys>[1]} */
  const handlers = {
    onPress: (action, event, at_ms, code) => press("key", action, event, at_ms, code),
    onRelease: (at_ms) => { up_ms = at_ms; },
    onEnter, codeOf, actionOf, onLetGo,
    onEvent({ type, repeat, isTrusted: trusted }, code, isOwn, at_ms) {
      if (type === "keydown") onActivity?.();
      if (code && !isOwn) note(/** @type {"keydown"} */ (type), { code, repeat, trusted, at_ms });
    },
  };
  hookKeys(window, handlers, window);
  for (const frame of frames) {
    frame.addEventListener("load", () => frame.contentWindow && hookKeys(/** @type {View} */ (frame.contentWindow), handlers, window));
  }
  const NOTED = /** @type {const} */ ({ pointerdown: ["touchdown"], pointerup: ["touchup"], pointercancel: ["touchup"], click: ["touchdown", "touchup"] });
  /** @param {PointerEvent} event */
  function touch(event) {
    const { type, detail, isTrusted: trusted } = event;
    const button = /** @type {HTMLElement | null} */ (/** @type {Element} */ (event.target).closest("[data-action]"));
    if (!button || (type === "click" && detail !== 0)) return; // a click without a pointer comes from a keyboard or an assistive tool
    const [action, at_ms] = [button.dataset.action ?? "", timeOf_ms(event, window, window)];
    const holder = `button ${action}`;
    for (const kind of NOTED[/** @type {"click"} */ (type)] ?? []) note(kind, { code: action, repeat: false, trusted, at_ms });
    if (type === "contextmenu") event.preventDefault();
    else if (type === "click") {
      press("touch", action, event, at_ms, holder);
      onLetGo?.(holder);
    } else if (type === "pointerdown") {
      if (event.button !== 0) return;
      event.preventDefault();
      button.classList.add("is-down");
      press("touch", action, event, at_ms, holder);
    } else if (type !== "pointerout" || !button.contains(/** @type {Node | null} */ (event.relatedTarget))) {
      if (type === "pointerout" && button.classList.contains("is-down")) note("touchup", { code: action, repeat: false, trusted, at_ms });
      if (button.classList.contains("is-down")) release(holder, at_ms);
      button.classList.remove("is-down");
    }
  }
  for (const kind of [...Object.keys(NOTED), "pointerout", "contextmenu"]) pad.addEventListener(kind, (event) => touch(/** @type {PointerEvent} */ (event)), true);
  addEventListener("pointerdown", () => onActivity?.(), true);
  addEventListener("focus", () => note("focus"));
  addEventListener("blur", () => note("blur"));
  document.addEventListener("visibilitychange", () => {
    look();
    if (document.hidden) leave();
    else flush();
  });
  addEventListener("pagehide", leave);
  return { press, release };
}
