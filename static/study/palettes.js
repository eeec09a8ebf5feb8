// @ts-check
// Three palettes for the page and its boards; the page's own colours stand in palettes.css under the same names.

/** @type {Record<Study.PaletteName, Study.Palette>} */
export const PALETTES = {
  mars: {
    title: "Mars", hint: "Soil and night",
    inks: { text: "#a8988d", goal: "#e8ddd3", base: "#5a453a", line: "#2a2023" },
  },
  "colour-blind": {
    title: "Colour-blind", hint: "Blue and yellow, told apart by lightness too",
    inks: { text: "#a9b7c6", goal: "#e6ecf2", base: "#4b5f76", line: "#1f2b39" },
  },
  "high-contrast": {
    title: "High contrast", hint: "White on black, strong edges",
    inks: { text: "#ffffff", goal: "#ffffff", base: "#ffffff", line: "#5a5a5a" },
  },
};

/** Return a kept name if it is one of ours, else what the system asks for.
 * @param {unknown} name @param {boolean} wantsContrast @returns {Study.PaletteName} */
export function readPalette(name, wantsContrast) {
  if (typeof name === "string" && Object.hasOwn(PALETTES, name)) return /** @type {Study.PaletteName} */ (name);
  return wantsContrast ? "high-contrast" : "mars";
}
