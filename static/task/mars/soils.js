// @ts-check
// The colours of cells: the page's own, or those of a palette of a study.
import { reader } from "../../common/colours.js";

/** The paper's values 0, 0.3, 1 as greys with a tint of soil; the rover (0.6) wears its board's colour, of the same lightness. */
const MARS_SHADES = { "?": "#070506", ".": "#57483f", "#": "#f4e9dc" };
/** @type {Record<string, Mars.Soil>} */
const SOILS = {
  mars: { shades: MARS_SHADES, edge: "#3a2d28", rockEdge: "#cdbfb0" },
  "colour-blind": { shades: { "?": "#04070b", ".": "#3f5068", "#": "#f2f4f7" }, edge: "#27374c", rockEdge: "#b9c3cf" },
  "high-contrast": { shades: { "?": "#000000", ".": "#6e6e6e", "#": "#ffffff" }, edge: "#000000", rockEdge: "#000000" },
};

/** @param {Element} element the board's canvas @param {string} [palette] of a study @returns {Mars.Soil} */
export function soilOf(element, palette) {
  if (palette) return SOILS[palette];
  const read = reader(element);
  const shades = { "?": read("--board-unknown"), ".": read("--board-ground"), "#": read("--board-rock") };
  return { shades, edge: read("--board-ground-edge"), rockEdge: read("--board-rock-edge"), casing: read("--board-casing") };
}
