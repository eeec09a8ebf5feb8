// @ts-check
// Which key drives where: two keys for each direction, each remappable, never one key for two directions. No document here.
import { ACTIONS } from "../common/messages.js";

/** @type {Readonly<Study.KeyMap>} */
export const DEFAULT_KEYS = Object.freeze({ north: ["ArrowUp", "KeyW"], east: ["ArrowRight", "KeyD"], south: ["ArrowDown", "KeyS"],
  west: ["ArrowLeft", "KeyA"] });
const DRIVING = /^(Key[A-Z]|Digit\d|Numpad\w+|Arrow(Up|Right|Down|Left)|Comma|Period|Slash|Semicolon|Quote|Bracket(Left|Right)|Backslash|Minus|Equal|Backquote|Intl\w+|Home|End|PageUp|PageDown|Insert|Delete)$/;
const NAMES = { ArrowUp: "\u2191", ArrowRight: "\u2192", ArrowDown: "\u2193", ArrowLeft: "\u2190", Comma: ",", Period: ".", Slash: "/",
  Semicolon: ";", Quote: "'", BracketLeft: "[", BracketRight: "]", Backslash: "\\", Minus: "-", Equal: "=", Backquote: "`" };
const SPOKEN = { ArrowUp: "arrow up", ArrowRight: "arrow right", ArrowDown: "arrow down", ArrowLeft: "arrow left" };

/** @param {string} code @returns whether a key may drive: Tab, Enter, Escape, space and the like stay with the page */
export const mayDrive = (code) => DRIVING.test(code) && code !== "NumpadEnter";

/** @param {Study.KeyMap} keys @param {string} code @returns {Action | undefined} where a key drives, or undefined */
export const actionOf = (keys, code) => ACTIONS.find((action) => keys[action].includes(code));

/** Return the map with `code` in a slot, or a sentence that says why not. A key that drove elsewhere changes places
 * with the one it replaces.
 * @param {Study.KeyMap} keys @param {Action} action @param {number} slot 0 or 1 @param {string} code
 * @returns {Study.KeyMap | string} */
export function assign(keys, action, slot, code) {
  if (!mayDrive(code)) return `${keyName(code)} cannot drive the rover: choose a letter, a digit, an arrow or a number-pad key.`;
  const old = keys[action][slot];
  const swapped = ACTIONS.map((each) => [each, keys[each].map((known, place) => {
    if (each === action && place === slot) return code;
    return known === code ? old : known;
  })]);
  return /** @type {Study.KeyMap} */ (Object.fromEntries(swapped));
}

/** Return a kept map if it is a whole one, else the default.
 * @param {Partial<Record<Action, unknown>> | null | undefined} kept @returns {Study.KeyMap} */
export function readKeys(kept) {
  const lists = ACTIONS.map((action) => kept?.[action]);
  const isWhole = lists.every((list) => Array.isArray(list) && list.length === 2 && list.every((code) => typeof code === "string" && mayDrive(code)));
  if (!isWhole || new Set(lists.flat()).size !== 8) return { ...DEFAULT_KEYS };
  return /** @type {Study.KeyMap} */ (Object.fromEntries(ACTIONS.map((action, index) => [action, lists[index]])));
}

/** @param {string} code @param {Study.Layout} [layout] of navigator.keyboard @returns what stands on a key */
export function keyName(code, layout) {
  const own = /** @type {Record<string, string>} */ (NAMES)[code];
  const printed = code.startsWith("Arrow") ? own : layout?.get(code) ?? own;
  return (printed ?? code.replace(/^(Key|Digit)/, "").replace(/^Numpad/, "Num ")).toUpperCase().replace("NUM ", "Num ");
}

/** @param {string} code @param {Study.Layout} [layout] @returns the same for a screen reader */
export const spokenKey = (code, layout) => /** @type {Record<string, string>} */ (SPOKEN)[code] ?? keyName(code, layout);
