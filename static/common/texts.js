// The texts of a page in its reader's language: the page comes with those of a study, and English stands in the code. Numbers, counts
// and times are written as that language does.

/** The page itself; none in a test of a module. */
const page = globalThis.document;
/** The language of the page. */
export const LANGUAGE = page?.documentElement.lang || "en";
/** By ID.
 * @type {Record<string, string>} */
const TEXTS = JSON.parse(page?.querySelector("#texts")?.textContent ?? "{}");

/** @param {string} text @param {Record<string, unknown>} values @returns the text with its placeholders filled in */
const filled = (text, values) => text.replace(/\{(\w+)\}/g, (whole, name) => (name in values ? String(values[name]) : whole));

/** Return a text in the language of the page.
 * @param {string} ident @param {string} english @param {Record<string, unknown>} [values] of its placeholders */
export const t = (ident, english, values = {}) => filled(TEXTS[ident] ?? english, values);

/** @param {{ident?: string | null, values?: Record<string, string> | null}} named a sentence of the server's @param {string} english
 * @returns it in the language of the page */
export const spoken = ({ ident, values }, english) => (ident ? t(ident, english, values ?? {}) : english);

const rules = new Intl.PluralRules(LANGUAGE);

/** Return a text that depends on a count, which is its placeholder {n}; a catalogue has a form for each of the language's kinds
 * of numbers, under the ID with the kind's name.
 * @param {string} ident @param {number} count @param {string} one @param {string} other @param {Record<string, unknown>} [values] */
export function plural(ident, count, one, other, values = {}) {
  const text = TEXTS[`${ident}.${rules.select(count)}`] ?? TEXTS[`${ident}.other`] ?? (count === 1 ? one : other);
  return filled(text, { n: count, ...values });
}

/** @type {Map<number, Intl.NumberFormat>} */
const FORMATS = new Map();

/** @param {number} value @param {number} digits after the point @returns a number as the language writes it */
export function fixed(value, digits) {
  const format = FORMATS.get(digits) ?? new Intl.NumberFormat(LANGUAGE, { minimumFractionDigits: digits, maximumFractionDigits: digits, useGrouping: false });
  FORMATS.set(digits, format);
  return format.format(value);
}

/** @param {number} at_ms @returns the time of day here, in hours and minutes */
export const timeText = (at_ms) => new Date(at_ms).toLocaleTimeString(LANGUAGE, { hour: "2-digit", minute: "2-digit" });
