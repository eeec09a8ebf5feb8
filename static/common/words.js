// Numbers in words; node can test every sentence.
import { fixed, plural, t } from "./texts.js";

/** @param {number} share 0..1; rounded down, so that 99.0 never stands before the goal is reached */
export const percent = (share) => fixed(Math.floor(share * 1000 + 1e-9) / 10, 1);
/** @param {number | null} value null while a study keeps it to itself */
export const signed = (value) => value === null ? "\u2013" : `${value < 0 ? "\u2212" : "+"}${Math.abs(value).toFixed(1)}`;
/** @param {number | null} value null while a study keeps it to itself */
export const score = (value) => value === null ? "\u2013" : fixed(value, 3).replace("-", "\u2212");
/** @param {number | [number, number]} size */
export const sizeText = (size) => (Array.isArray(size) ? size : [size, size]).join(" \u00d7 ");
/** @param {string} text @returns the text with a capital in front */
export const capital = (text) => text.replace(/^./, (first) => first.toUpperCase());
/** @param {string} action @returns {string} "pick_up" as "pick up" */
export const actionText = (action) => t(`action.${action}`, action.replaceAll("_", " "));
/** @param {string} name "A person", "Your replay" or a policy's @returns the name as it stands within a sentence */
export const within = (name) => name.replace(/^(A|Your) /, (article) => article.toLowerCase());
/** Return a count with its noun.
 * @param {number} count @param {string} one @param {string} [more] the plural, where it is not the singular and an s */
export const many = (count, one, more = `${one}s`) => `${count} ${count === 1 ? one : more}`;

/** @param {number} count @returns a number of moves */
export const movesText = (count) => plural("moves", count, "{n} move", "{n} moves");

/** What is said where the server answers and yet no socket opens. */
export const HELD_BACK_TEXT = t("link.held_back", "The server answers, but the live connection (a WebSocket) does not open: a proxy between you and it holds it back. Ask whoever runs this server to let their proxy pass on the headers Upgrade and Connection, or try another network.");

/** Return the sentence for an episode that has ended and does not count, because the server could not match a move with
 * a key or a touch.
 * @param {string} reason the server's @param {string | null} level */
export const notCounted = (reason, level) => `This episode ${level === "spoilt" ? "counts as abandoned" : "does not count"}: its moves do not all fit keys or touches of this page (${reason}).`;
