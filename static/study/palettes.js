// @ts-check
// Three palettes for the page and its boards; the page's own colours stand in palettes.css under the same names.

/** The paper's values 0, 0.3, 1 as greys with a tint of soil; the rover (0.6) wears its board's colour, of the same lightness. */
const MARS_SHADES = { "?": "#070506", ".": "#57483f", "#": "#f4e9dc" };
/** @type {Record<Study.PaletteName, Study.Palette>} */
export const PALETTES = {
  mars: {
    title: "Mars", hint: "Soil and night", soil: { shades: MARS_SHADES, edge: "#3a2d28", rockEdge: "#cdbfb0" },
    inks: { text: "#a8988d", goal: "#e8ddd3", base: "#5a453a", line: "#2a2023" },
  },
  "colour-blind": {
    title: "Colour-blind", hint: "Blue and yellow, told apart by lightness too",
    soil: { shades: { "?": "#04070b", ".": "#3f5068", "#": "#f2f4f7" }, edge: "#27374c", rockEdge: "#b9c3cf" },
    inks: { text: "#a9b7c6", goal: "#e6ecf2", base: "#4b5f76", line: "#1f2b39" },
  },
  "high-contrast": {
    title: "High contrast", hint: "White on black, strong edges",
    soil: { shades: { "?": "#000000", ".": "#6e6e6e", "#": "#ffffff" }, edge: "#000000", rockEdge: "#000000" },
    inks: { text: "#ffffff", goal: "#ffffff", base: "#ffffff", line: "#5a5a5a" },
  },
};

/** Return a kept name if it is one of ours, else what the system asks for.
 * @param {unknown} name @param {boolean} wantsContrast @returns {Study.PaletteName} */
export function readPalette(name, wantsContrast) {
  if (typeof name === "string" && Object.hasOwn(PALETTES, name)) return /** @type {Study.PaletteName} */ (name);
  return wantsContrast ? "high-contrast" : "mars";
}
