// Which keys drive: chosen in a dialog by pressing them (keymap.html).
import { codesOf } from "./keyboard.js";
import { by, create, put } from "./page.js";
import { browserStore } from "./storage.js";
import { keyName } from "./task.js";
import { t } from "./texts.js";
import { actionText } from "./words.js";

/** Where the keys are that were chosen to drive, a map for each task. */
const CHOSEN = "humanplay.keys";

/** Let the keys in a dialog be chosen.
 *   keys      those that drive now
 *   onChange  other keys drive
 *   onLayout  the browser says what is printed on the keys
 * @param {HTMLElement} dialog
 * @param {{keys: () => Keys, onChange: (keys: Keys) => void, onLayout: () => void}} how */
export function startKeymap(dialog, { keys, onChange, onLayout }) {
  /** @type {Keys} the task's own, none before it is known */
  let own = {};
  /** @type {Study.Layout | undefined} */
  let layout;
  /** @type {{action: Action, slot: number} | null} a slot that waits for its key */
  let awaited = null;
  const say = (/** @type {string} */ text) => put(by("key-status"), text);

  function paint() {
    for (const button of /** @type {NodeListOf<HTMLButtonElement>} */ (document.querySelectorAll("#keymap button"))) {
      const action = /** @type {Action} */ (button.dataset.drive);
      const slot = Number(button.dataset.slot);
      const isAwaited = awaited?.action === action && awaited.slot === slot;
      const code = keys()[action][slot];
      put(button, isAwaited ? t("keys.press", "press a key") : keyName(code, layout));
      button.dataset.awaited = String(isAwaited);
      const spoken = isAwaited ? t("keys.press_wanted", "press the key you want") : spokenKey(code, layout);
      const named = { action: actionText(action), key: spoken };
      button.setAttribute("aria-label", slot === 0 ? t("keys.first", "{action}, first key: {key}", named) : t("keys.second", "{action}, second key: {key}", named));
    }
  }
  /** @param {Action} action @param {number} slot */
  function cell(action, slot) {
    const attributes = { "data-drive": action, "data-slot": String(slot), "data-testid": `key-${action}-${slot}` };
    return create("td", create("button", [], { type: "button", class: "quiet", ...attributes }));
  }
  function leave() {
    awaited = null;
    say("");
    paint();
  }
  by("reset-keys").addEventListener("click", () => {
    awaited = null;
    onChange({ ...own });
    paint();
    say(t("keys.are_reset", "The keys are reset."));
  });
  by("keymap").addEventListener("click", (event) => {
    const button = /** @type {Element} */ (event.target).closest("button");
    if (!button) return;
    awaited = { action: /** @type {Action} */ (button.dataset.drive), slot: Number(button.dataset.slot) };
    say(t("keys.press_for", "Press the key for {action}; Escape leaves it as it is.", { action: actionText(awaited.action) }));
    paint();
  });
  dialog.addEventListener("keydown", (event) => {
    if (!awaited || /^(Shift|Control|Alt|Meta|OS|AltGraph)/.test(event.key)) return;
    if (event.key === "Tab") return leave();
    event.preventDefault();
    event.stopPropagation();
    const { action, slot } = awaited;
    if (event.key === "Escape") return leave();
    const code = codesOf(event)[0] ?? event.key;
    const changed = assign(keys(), action, slot, code);
    if (typeof changed === "string") return say(changed);
    awaited = null;
    onChange(changed);
    paint();
    say(t("keys.now", "{key} is now {action}.", { key: keyName(code, layout), action: actionText(action) }));
  });
  dialog.addEventListener("close", leave);
  /** @type {Navigator & {keyboard?: {getLayoutMap?: () => Promise<Study.Layout>}}} */ (navigator).keyboard?.getLayoutMap?.().then((map) => {
    layout = map;
    paint();
    onLayout();
  }, () => {});
  return {
    /** Show the keys of a task.
     * @param {Keys} first the task's own */
    begin(first) {
      own = first;
      by("keymap-part").hidden = !canChange(own);
      by("keymap").replaceChildren(...Object.entries(own).map(([action, codes]) =>
        create("tr", [create("th", actionText(action), { scope: "row" }), ...codes.map((_, slot) => cell(action, slot))])));
      paint();
    },
    paint,
    layout: () => layout,
  };
}

const MOVING = /^(Key[A-Z]|Digit\d|Numpad\w+|Arrow(Up|Right|Down|Left)|Comma|Period|Slash|Semicolon|Quote|Bracket(Left|Right)|Backslash|Minus|Equal|Backquote|Intl\w+|Home|End|PageUp|PageDown|Insert|Delete)$/;
const SPOKEN = {
  ArrowUp: t("keys.arrow_up", "arrow up"), ArrowRight: t("keys.arrow_right", "arrow right"), ArrowDown: t("keys.arrow_down", "arrow down"),
  ArrowLeft: t("keys.arrow_left", "arrow left"),
};

/** @param {string} code @returns whether a key may drive: Tab, Enter, Escape, space and the like stay with the page */
export const mayDrive = (code) => MOVING.test(code) && code !== "NumpadEnter";

/** @param {Keys} keys @returns whether each of them may be exchanged for another */
const canChange = (keys) => Object.values(keys).flat().every(mayDrive);

/** Return the map with `code` in a slot, or a sentence that says why not. A key that drove elsewhere changes places with the
 * one it replaces.
 * @param {Keys} keys @param {Action} action @param {number} slot 0 or 1 @param {string} code @returns {Keys | string} */
export function assign(keys, action, slot, code) {
  if (!mayDrive(code)) return t("keys.cannot", "{key} cannot be chosen: take a letter, a digit, an arrow or a number-pad key.", { key: keyName(code) });
  const old = keys[action][slot];
  return Object.fromEntries(Object.entries(keys).map(([each, codes]) => [each, codes.map((known, place) => {
    if (each === action && place === slot) return code;
    return known === code ? old : known;
  })]));
}

/** Return a stored map if it is a whole one of the task's, else the task's own.
 * @param {Record<string, unknown> | null | undefined} stored @param {Keys} own @returns {Keys} */
export function readKeys(stored, own) {
  const lists = Object.entries(own).map(([action, codes]) => ({ list: stored?.[action], of: codes.length }));
  const usual = Object.values(own).flat();
  const isWhole = lists.every(({ list, of }) => Array.isArray(list) && list.length === of && list.every((code) => typeof code === "string" && (mayDrive(code) || usual.includes(code))));
  const codes = lists.flatMap(({ list }) => list);
  if (!isWhole || new Set(codes).size !== codes.length) return { ...own };
  return Object.fromEntries(Object.keys(own).map((action, index) => [action, /** @type {string[]} */ (lists[index].list)]));
}

/** @param {Keys | null | undefined} keys @param {Keys | null | undefined} others @returns whether the same keys drive the same way */
export const sameKeys = (keys, others) => JSON.stringify(keys) === JSON.stringify(others);

/** @param {Pick<Task, "name" | "keys">} task @returns {Keys} those that were chosen in this browser, else the task's own */
export const chosenKeys = ({ name, keys }) => readKeys(browserStore.read(CHOSEN)?.[name], keys);

/** @param {Pick<Task, "name">} task @param {Keys} keys */
export const storeKeys = ({ name }, keys) => browserStore.setItem(CHOSEN, JSON.stringify({ ...browserStore.read(CHOSEN), [name]: keys }));

/** Return the task's own code of a key that was chosen in its place: the episode is recorded as everybody's.
 * @param {Keys} keys that were chosen @param {Keys} own @param {string} code @returns {string | undefined} */
export function ownCode(keys, own, code) {
  for (const [action, codes] of Object.entries(keys)) {
    const slot = codes.indexOf(code);
    if (slot >= 0) return own[action][slot];
  }
  return undefined;
}

/** @param {string} code @param {Study.Layout} [layout] @returns the same for a screen reader */
export const spokenKey = (code, layout) => /** @type {Record<string, string>} */ (SPOKEN)[code] ?? keyName(code, layout);

/** Paint the keys as they drive now, wherever the page shows them: with what they do, or alone; the first of each, or two.
 * @param {Pick<Task, "allowed" | "order">} task @param {Keys} keys @param {Study.Layout} [layout] */
export function paintKeys({ allowed, order }, keys, layout) {
  const slots = [...Array(Math.min(2, ...order.map((action) => keys[action]?.length ?? 0))).keys()];
  const key = (/** @type {Action} */ action, slot = 0) => create("kbd", keyName(keys[action][slot] ?? "", layout));
  const alone = () => slots.flatMap((slot) => [...(slot ? [` ${t("keys.or", "or")} `] : []), ...order.map((action) => key(action, slot))]);
  const named = () => order.flatMap((action) => [create("span", [key(action), ` ${actionText(action)}`], { "data-key-of": action }), " "]);
  for (const line of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("[data-keys]"))) {
    if (line.dataset.keys === "alone") line.replaceChildren(...alone());
    else if (line.dataset.keys === "first") line.replaceChildren(...order.map((action) => key(action)));
    else if (!allowed || !line.matches(".keys")) line.replaceChildren(...alone(), ` ${t("keys.for", "for {actions}", { actions: order.map(actionText).join(", ") })}`);
    else line.replaceChildren(...named());
  }
}
