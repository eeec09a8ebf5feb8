// The colours of boards and charts, read from the custom properties of base.css while something is painted, so that a theme may change.

/** @param {Element} element @returns what reads its custom properties */
export function reader(element) {
  const style = getComputedStyle(element);
  return (/** @type {string} */ name) => style.getPropertyValue(name).trim();
}

/** Return the colours of a board: of the player, of the policy, of a better move, and of what is drawn round things.
 * They are the same in every theme.
 * @param {Element} element the board's canvas, or anything around it */
export function boardColours(element) {
  const read = reader(element);
  return { you: read("--board-you"), policy: read("--board-policy"), better: read("--board-better"), casing: read("--board-casing") };
}

/** Return the colours of a chart, which follow the theme of the page, and the face of its numbers.
 * @param {Element} element the chart's canvas, or anything around it
 * @returns {{inks: Inks, you: string, policy: string, ground: string, font: string}} */
export function chartColours(element) {
  const read = reader(element);
  const inks = { text: read("--chart-text"), goal: read("--chart-goal"), base: read("--chart-base"), line: read("--chart-line") };
  return { inks, you: read("--chart-you"), policy: read("--chart-policy"), ground: read("--panel"), font: read("--figures") };
}
