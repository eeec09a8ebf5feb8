// @ts-check
// Costly moves marked on a board: a number at the cell of each, the move made and the better one as arrows, and what was missed.

/** @type {Record<Action, [number, number]>} unit vectors (x, y) */
const OUTWARD = { north: [0, -1], east: [1, 0], south: [0, 1], west: [-1, 0] };
/** Where a number goes when another one stands there already, in its own diameters. */
const ASIDE = [[0, 0], [1, 0], [0, 1], [-1, 0], [0, -1], [1, 1], [-1, 1], [1, -1], [-1, -1]];

/** @param {number} size cell, device pixels @param {number} dpr @returns the radius of a number */
export const markRadius = (size, dpr) => Math.max(8.5 * dpr, Math.min(0.6 * size, 13 * dpr));

/** Return where the numbers stand: at their cells, aside where one stands there already.
 * @param {CostlyMove[]} losses @param {number} size cell, device pixels @param {number} radius @returns {Point[]} */
export function placeMarks(losses, size, radius) {
  /** @type {Point[]} */
  const placed = [];
  for (const { position: [row, col] } of losses) {
    const home = { x: (col + 0.5) * size, y: (row + 0.5) * size };
    const choices = ASIDE.map(([x, y]) => ({ x: home.x + 2 * radius * x, y: home.y + 2 * radius * y }));
    const isFree = (/** @type {Point} */ { x, y }) => x > 0 && y > 0 && placed.every((other) => Math.hypot(x - other.x, y - other.y) >= 1.9 * radius);
    placed.push(choices.find(isFree) ?? home);
  }
  return placed;
}

/** Return the index of the number at a point, null where there is none.
 * @param {CostlyMove[]} losses @param {Point} point @param {number} size cell, device pixels @param {number} dpr */
export function markAt(losses, { x, y }, size, dpr) {
  const radius = markRadius(size, dpr);
  const distances = placeMarks(losses, size, radius).map((mark) => Math.hypot(mark.x - x, mark.y - y));
  const nearest = Math.min(...distances);
  return nearest <= radius + 6 * dpr ? distances.indexOf(nearest) : null;
}

/** Paint the marks over a board; with one chosen, its arrows and what was missed, and the others fainter.
 * @param {CanvasRenderingContext2D} context @param {Marks} marks @param {number} size cell, device pixels
 * @param {{made: string, better: string, casing: string, dpr: number}} look */
export function paintLossMarks(context, { losses, chosen }, size, { made, better, casing, dpr }) {
  const radius = markRadius(size, dpr);
  const places = placeMarks(losses, size, radius);
  context.save();
  if (chosen !== null) paintMissed(context, losses[chosen].missed, size, better, dpr);
  const order = losses.map((_, index) => index).filter((index) => index !== chosen).reverse();
  for (const index of chosen === null ? order : [chosen]) {
    const { action, best_action, position: [row, col] } = losses[index];
    const home = { x: (col + 0.5) * size, y: (row + 0.5) * size };
    const length = Math.max(1.6 * size, 2.4 * radius) * (chosen === null ? 1 : 1.25);
    paintArrow(context, home, OUTWARD[action], length, { colour: made, casing, dpr, isDashed: true });
    paintArrow(context, home, OUTWARD[best_action], length, { colour: better, casing, dpr, isDashed: false });
  }
  for (const index of chosen === null ? order : [...order, chosen]) {
    const isChosen = index === chosen;
    context.globalAlpha = chosen === null || isChosen ? 1 : 0.4;
    paintNumber(context, places[index], index + 1, { radius, dpr, ring: made, fill: isChosen ? made : casing, ink: isChosen ? casing : "#ffffff" });
  }
  context.restore();
}

/** @param {CanvasRenderingContext2D} context @param {Cell[]} cells @param {number} size @param {string} colour
 * @param {number} dpr */
function paintMissed(context, cells, size, colour, dpr) {
  context.fillStyle = context.strokeStyle = colour;
  context.lineWidth = Math.max(1, dpr);
  for (const [row, col] of cells) {
    context.globalAlpha = 0.24;
    context.fillRect(col * size, row * size, size, size);
    context.globalAlpha = 0.8;
    if (size >= 5) context.strokeRect(col * size + 1.5, row * size + 1.5, size - 3, size - 3);
  }
  context.globalAlpha = 1;
}

/** @param {CanvasRenderingContext2D} context @param {Point} from @param {[number, number]} towards unit vector
 * @param {number} length @param {{colour: string, casing: string, dpr: number, isDashed: boolean}} look */
function paintArrow(context, { x, y }, [right, down], length, { colour, casing, dpr, isDashed }) {
  const head = Math.max(7 * dpr, 0.3 * length);
  const neck = length - head;
  const tip = { x: x + right * length, y: y + down * length };
  for (const [ink, width] of /** @type {[string, number][]} */ ([[casing, 6 * dpr], [colour, 3 * dpr]])) {
    context.strokeStyle = context.fillStyle = ink;
    context.lineWidth = width;
    context.setLineDash(isDashed && ink === colour ? [4 * dpr, 3 * dpr] : []);
    context.beginPath();
    context.moveTo(x, y);
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
