// @ts-check
// Costly moves marked on the coverage chart: a number on the player's curve at the step of each.
import { paintNumber } from "./loss_marks.js";

const RADIUS_PX = 8;

/** Return where the numbers stand: on the curve, or above one that stands there already (below it where there is no
 * room).
 * @param {{step: number, discovered: number}[]} losses @param {number} cells of the terrain @param {ChartScale} at
 * @returns {Point[]} */
export function placeOnCurve(losses, cells, at) {
  /** @type {Point[]} */
  const placed = [];
  for (const { step, discovered } of losses) {
    const home = { x: at.x(step), y: at.y(discovered / cells) };
    const choices = [0, -1, -2, -3, -4, 1, 2, 3, 4].map((times) => ({ x: home.x, y: home.y + times * 2.1 * RADIUS_PX }));
    const isFree = (/** @type {Point} */ { x, y }) => y > RADIUS_PX && y < at.y(0) - 2 && placed.every((other) => Math.hypot(x - other.x, y - other.y) >= 2 * RADIUS_PX);
    placed.push(choices.find(isFree) ?? home);
  }
  return placed;
}

/** Return the index of the number at a point of the chart, null where there is none.
 * @param {Point[]} places @param {Point} point */
export function chartMarkAt(places, { x, y }) {
  const distances = places.map((place) => Math.hypot(place.x - x, place.y - y));
  const nearest = Math.min(...distances);
  return nearest <= RADIUS_PX + 6 ? distances.indexOf(nearest) : null;
}

/** Paint the numbers, the chosen one over a line down to its step.
 * @param {CanvasRenderingContext2D} context in CSS pixels @param {Point[]} places @param {number | null} chosen
 * @param {{ring: string, fill: string, ink: string, base_px: number}} look */
export function paintOnCurve(context, places, chosen, { ring, fill, ink, base_px }) {
  context.save();
  const order = places.map((_, index) => index).filter((index) => index !== chosen).reverse();
  for (const index of chosen === null ? order : [...order, chosen]) {
    const isChosen = index === chosen;
    context.globalAlpha = chosen === null || isChosen ? 1 : 0.45;
    if (isChosen) {
      context.fillStyle = ring;
      context.fillRect(places[index].x - 0.75, places[index].y, 1.5, base_px - places[index].y);
    }
    paintNumber(context, places[index], index + 1, { radius: RADIUS_PX, dpr: 0.8, ring, fill: isChosen ? ring : fill, ink: isChosen ? fill : ink });
  }
  context.restore();
}
