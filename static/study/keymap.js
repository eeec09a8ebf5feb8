// @ts-check
// Which key makes which move: two keys for each, where the task has as many, each remappable, never one key for two moves. No document here.
import { keyName } from "../common/task.js";

const DRIVING = /^(Key[A-Z]|Digit\d|Numpad\w+|Arrow(Up|Right|Down|Left)|Comma|Period|Slash|Semicolon|Quote|Bracket(Left|Right)|Backslash|Minus|Equal|Backquote|Intl\w+|Home|End|PageUp|PageDown|Insert|Delete)$/;
const SPOKEN = { ArrowUp: "arrow up", ArrowRight: "arrow right", ArrowDown: "arrow down", ArrowLeft: "arrow left" };

/** @param {string} code @returns whether a key may drive: Tab, Enter, Escape, space and the like stay with the page */
export const mayDrive = (code) => DRIVING.test(code) && code !== "NumpadEnter";

/** Return the map with `code` in a slot, or a sentence that says why not. A key that drove elsewhere changes places
 * with the one it replaces.
 * @param {Keys} keys @param {Action} action @param {number} slot 0 or 1 @param {string} code
 * @returns {Keys | string} */
export function assign(keys, action, slot, code) {
  if (!mayDrive(code)) return `${keyName(code)} cannot drive here: choose a letter, a digit, an arrow or a number-pad key.`;
  const old = keys[action][slot];
  return Object.fromEntries(Object.entries(keys).map(([each, codes]) => [each, codes.map((known, place) => {
    if (each === action && place === slot) return code;
    return known === code ? old : known;
  })]));
}

/** Return a kept map if it is a whole one of the task's, else the task's own.
 * @param {Record<string, unknown> | null | undefined} kept @param {Keys} own @returns {Keys} */
export function readKeys(kept, own) {
  const lists = Object.entries(own).map(([action, codes]) => ({ list: kept?.[action], of: codes.length }));
  const isWhole = lists.every(({ list, of }) => Array.isArray(list) && list.length === of && list.every((code) => typeof code === "string" && mayDrive(code)));
  const codes = lists.flatMap(({ list }) => list);
  return isWhole && new Set(codes).size === codes.length ? Object.fromEntries(Object.keys(own).map((action, index) => [action, /** @type {string[]} */ (lists[index].list)])) : { ...own };
}

/** @param {string} code @param {Study.Layout} [layout] @returns the same for a screen reader */
export const spokenKey = (code, layout) => /** @type {Record<string, string>} */ (SPOKEN)[code] ?? keyName(code, layout);
