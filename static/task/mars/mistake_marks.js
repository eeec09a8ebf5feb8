// Costly moves marked on a board: a number at the cell of each, the move made and the better one as arrows, and what was missed;
// and on the chart: a number on the player's curve at the step of each.
import { WAYS } from "./ground.js";

/** Where a number may stand: off the corners of its cell, between the arrows, and further out where others stand there. */
const CORNERS = [[1, -1], [-1, -1], [1, 1], [-1, 1]];
const ASIDE = [...CORNERS, ...CORNERS.map(([across, along]) => [3 * across, along]), ...CORNERS.map(([across, along]) => [across, 3 * along])];

/** @param {number} size cell, device pixels @param {number} dpr @returns the radius of a number */
export const markRadius = (size, dpr) => Math.max(8.5 * dpr, Math.min(0.6 * size, 13 * dpr));

/** Return where numbers stand: at their homes, or aside where one stands there already.
 * @param {Point[]} homes @param {number[][]} aside in multiples of `step` @param {number} step
 * @param {(point: Point) => boolean} isInside @param {number} apart the least distance of two @returns {Point[]} */
function placed(homes, aside, step, isInside, apart) {
  /** @type {Point[]} */
  const found = [];
  for (const { x, y } of homes) {
    const choices = aside.map(([across, along]) => ({ x: x + step * across, y: y + step * along }));
    found.push(choices.find((point) => isInside(point) && found.every((other) => Math.hypot(point.x - other.x, point.y - other.y) >= apart)) ?? { x, y });
  }
  return found;
}
/** @param {Point[]} places @param {Point} point @param {number} reach @returns the index of the nearest, null beyond reach */
function nearest(places, { x, y }, reach) {
  const distances = places.map((place) => Math.hypot(place.x - x, place.y - y));
  const least = Math.min(...distances);
  return least <= reach ? distances.indexOf(least) : null;
}

/** @param {Mars.Mistake} mistake @param {number} size cell @returns {Point} the middle of its cell */
const homeOf = ({ position: [row, col] }, size) => ({ x: (col + 0.5) * size, y: (row + 0.5) * size });

/** Return where the numbers stand on a board: beside their cells, so that none hides the rover or another one.
 * @param {Mars.Mistake[]} mistakes @param {Mars.Shape} shape of the board @param {number} size cell, device pixels @param {number} radius */
export function placeMarks(mistakes, { rows, cols }, size, radius) {
  const homes = mistakes.map((mistake) => homeOf(mistake, size));
  const isInside = (/** @type {Point} */ { x, y }) => x >= radius && y >= radius && x <= cols * size - radius && y <= rows * size - radius;
  const isClear = (/** @type {Point} */ { x, y }) => homes.every((home) => Math.max(Math.abs(home.x - x), Math.abs(home.y - y)) >= 0.5 * size + 0.7 * radius);
  return placed(homes, ASIDE, 0.5 * size + 0.75 * radius, (point) => isInside(point) && isClear(point), 2.1 * radius);
}

/** Return the index of the number at a point of a board, null where there is none.
 * @param {Mars.Mistake[]} mistakes @param {Mars.Shape} shape of the board @param {Point} point @param {number} size cell, device pixels @param {number} dpr */
export function numberAt(mistakes, shape, point, size, dpr) {
  const radius = markRadius(size, dpr);
  return nearest(placeMarks(mistakes, shape, size, radius), point, radius + 6 * dpr);
}

/** Paint the marks over a board: each number led to its cell, since arrows of neighbours hide one another; with one chosen,
 * its arrows and what was missed, and the others fainter.
 * @param {CanvasRenderingContext2D} context @param {Mars.Marks} marks @param {number} size cell, device pixels
 * @param {Mars.Shape & {made: string, better: string, casing: string, dpr: number}} look */
export function paintMistakeMarks(context, { mistakes, chosen, hasNumbers = true }, size, { rows, cols, made, better, casing, dpr }) {
  const radius = markRadius(size, dpr);
  const places = placeMarks(mistakes, { rows, cols }, size, radius);
  context.save();
  if (chosen !== null) paintMissed(context, mistakes[chosen].missed, size, better, dpr);
  const order = mistakes.map((_, index) => index).filter((index) => index !== chosen).reverse();
  for (const index of chosen === null ? order : []) paintLeader(context, homeOf(mistakes[index], size), places[index], { colour: made, casing, dpr });
  if (chosen !== null) {
    const { action, expert_action } = mistakes[chosen];
    const home = homeOf(mistakes[chosen], size);
    const edge = { right: cols * size, bottom: rows * size };
    const length = 1.25 * Math.max(1.6 * size, 2.4 * radius);
    const gap = hasNumbers ? 0 : 0.5 * size; // the rover's own arrow stays in sight
    paintArrow(context, home, WAYS[action], length, { edge, gap, colour: made, casing, dpr, isDashed: true });
    paintArrow(context, home, WAYS[expert_action], length, { edge, gap, colour: better, casing, dpr, isDashed: false });
  }
  for (const index of !hasNumbers ? [] : chosen === null ? order : [...order, chosen]) {
    const isChosen = index === chosen;
    context.globalAlpha = chosen === null || isChosen ? 1 : 0.4;
    paintNumber(context, places[index], index + 1, { radius, dpr, ring: made, fill: isChosen ? made : casing, ink: isChosen ? casing : made });
  }
  context.restore();
}

/** Lead a number to the cell that it stands for.
 * @param {CanvasRenderingContext2D} context @param {Point} home @param {Point} place @param {{colour: string, casing: string, dpr: number}} look */
function paintLeader(context, home, place, { colour, casing, dpr }) {
  for (const [ink, width] of /** @type {[string, number][]} */ ([[casing, 4 * dpr], [colour, 2 * dpr]])) {
    context.strokeStyle = context.fillStyle = ink;
    context.lineWidth = width;
    context.beginPath();
    context.moveTo(home.x, home.y);
    context.lineTo(place.x, place.y);
    context.stroke();
    context.beginPath();
    context.arc(home.x, home.y, 2 * dpr + width / 2, 0, 7);
    context.fill();
  }
}

/** @param {CanvasRenderingContext2D} context @param {Cell[]} cells @param {number} size @param {string} colour
 * @param {number} dpr */
function paintMissed(context, cells, size, colour, dpr) {
  context.fillStyle = context.strokeStyle = colour;
  context.lineWidth = Math.max(1, dpr);
  for (const [row, col] of cells) {
    context.globalAlpha = 0.4;
    context.fillRect(col * size, row * size, size, size);
    context.globalAlpha = 0.8;
    if (size >= 5) context.strokeRect(col * size + 1.5, row * size + 1.5, size - 3, size - 3);
  }
  context.globalAlpha = 1;
}

/** @param {CanvasRenderingContext2D} context @param {Point} from @param {Cell} way rows down and columns right
 * @param {number} wanted length @param {{edge: {right: number, bottom: number}, gap: number, colour: string, casing: string, dpr: number, isDashed: boolean}} look
 *   edge: of the board, within which the head stays; gap: before the arrow begins */
function paintArrow(context, { x, y }, [down, right], wanted, { edge, gap: wantedGap, colour, casing, dpr, isDashed }) {
  const toEdge = right ? (right > 0 ? edge.right - x : x) : (down > 0 ? edge.bottom - y : y);
  const length = Math.max(Math.min(wanted, toEdge - 2 * dpr), 4 * dpr);
  const head = Math.min(Math.max(7 * dpr, 0.3 * wanted), 0.75 * length);
  const gap = Math.min(wantedGap, length - head);
  const neck = length - head;
  const tip = { x: x + right * length, y: y + down * length };
  for (const [ink, width] of /** @type {[string, number][]} */ ([[casing, 6 * dpr], [colour, 3 * dpr]])) {
    context.strokeStyle = context.fillStyle = ink;
    context.lineWidth = width;
    context.setLineDash(isDashed && ink === colour ? [4 * dpr, 3 * dpr] : []);
    context.beginPath();
    context.moveTo(x + right * gap, y + down * gap);
    context.lineTo(x + right * neck, y + down * neck);
    context.stroke();
    context.setLineDash([]);
    context.lineWidth = ink === casing ? 3 * dpr : 0;
    context.beginPath();
    context.moveTo(tip.x, tip.y);
    context.lineTo(x + right * neck - down * head * 0.6, y + down * neck + right * head * 0.6);
    context.lineTo(x + right * neck + down * head * 0.6, y + down * neck - right * head * 0.6);
    context.closePath();
    if (ink === casing) context.stroke();
    context.fill();
  }
}

/** @param {CanvasRenderingContext2D} context @param {Point} at @param {number} number
 * @param {{radius: number, dpr: number, ring: string, fill: string, ink: string}} look in the context's own pixels */
export function paintNumber(context, { x, y }, number, { radius, dpr, ring, fill, ink }) {
  context.beginPath();
  context.arc(x, y, radius, 0, 7);
  context.fillStyle = fill;
  context.fill();
  context.strokeStyle = ring;
  context.lineWidth = 2 * dpr;
  context.stroke();
  context.fillStyle = ink;
  context.font = `700 ${Math.round(1.25 * radius)}px system-ui, sans-serif`;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(String(number), x, y + 0.06 * radius);
}

const RADIUS_PX = 8;

/** Return where the numbers stand on the curve, or above one that stands there already (below where there is no room).
 * @param {{step: number, discovered: number}[]} mistakes @param {number} cells of the terrain @param {ChartScale} at */
export function placeOnCurve(mistakes, cells, at) {
  const homes = mistakes.map(({ step, discovered }) => ({ x: at.x(step), y: at.y(discovered / cells) }));
  return placed(homes, [0, -1, -2, -3, -4, 1, 2, 3, 4].map((times) => [0, times]), 2.1 * RADIUS_PX,
    ({ y }) => y > RADIUS_PX && y < at.y(0) - 2, 2 * RADIUS_PX);
}

/** Return the index of the number at a point of the chart, null where there is none.
 * @param {Point[]} places @param {Point} point */
export const chartMarkAt = (places, point) => nearest(places, point, RADIUS_PX + 6);

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
