// The state matrix on a canvas (figure 2b of the paper): here, and only here, a (row, col) becomes pixels.
import { boardColours, reader } from "../../common/page.js";
import { paintMistakeMarks } from "./mistake_marks.js";
import { paintShares } from "./course.js";
import { cellAfter, linesOf } from "./ground.js";
import { describe, runs } from "./words.js";
import { follow, LARGE_SIDE, release, shrunkTo, smallMap } from "./zoom.js";

/** How far the lidar of every board of the playground sees (EnvConfig.sensor_radius). */
const LIDAR_CELLS = 6;

/** Return the largest whole number of device pixels per cell that fits.
 * @param {number} width_px @param {number} height_px @param {number} rows @param {number} cols @param {number} dpr */
export function cellSize(width_px, height_px, rows, cols, dpr) {
  return Math.max(1, Math.floor(Math.min((width_px * dpr) / cols, (height_px * dpr) / rows)));
}

/** Paint one board to fill its place, crisp at any pixel ratio, and say it in words there.
 * @param {HTMLElement} place with a canvas @param {{frame: Mars.Frame, trail: Cell[]}} board @param {Mars.Look} look */
export function paint(place, board, look) {
  const canvas = /** @type {HTMLCanvasElement} */ (place.querySelector("canvas"));
  const { frame, trail } = board;
  canvas.setAttribute("aria-label", describe(frame, look.name));
  if (!(look.width_px > 0 && look.height_px > 0)) return;
  const fit = cellSize(look.width_px, look.height_px, frame.rows, frame.cols, look.dpr);
  const isFollowed = look.follows && !frame.outcome && Math.max(frame.rows, frame.cols) > LARGE_SIDE;
  if (!isFollowed) release(place);
  const whole = { size: fit, left: 0, top: 0, width: fit * frame.cols, height: fit * frame.rows };
  const shown = isFollowed ? follow(place, frame, look, fit, () => paint(place, board, look)) : whole;
  const { size, width, height } = shown;
  const shrunk = shrunkTo(look.width_px, look.height_px, width / look.dpr, height / look.dpr);
  canvas.style.width = `${(shrunk * width) / look.dpr}px`;
  canvas.style.height = `${(shrunk * height) / look.dpr}px`;
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width;
    canvas.height = height;
  }
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d", { alpha: false }));
  const soil = soilOf(canvas, look.palette);
  context.setTransform(1, 0, 0, 1, -shown.left, -shown.top);
  paintCells(context, frame, size, soil);
  if (look.ghost) paintTrail(context, look.ghost.trail, size, { accent: look.ghost.accent, casing: soil.casing, isGhost: true });
  paintTrail(context, trail, size, { accent: look.accent, casing: soil.casing });
  if (look.has_range && !frame.outcome) paintRange(context, frame.position, size, { reach_px: LIDAR_CELLS * size, accent: look.accent, casing: soil.casing, dpr: look.dpr });
  if (look.shares) paintShares(context, look.shares, frame.position, size, { colour: boardColours(canvas).policy, dpr: look.dpr });
  paintRover(context, frame, size, { accent: look.accent, casing: soil.casing, dpr: look.dpr });
  if (hasCrashed(frame)) paintCrash(context, frame, size, { colour: boardColours(canvas).alarm, dpr: look.dpr });
  if (look.marks) paintMistakeMarks(context, look.marks, size, { rows: frame.rows, cols: frame.cols, made: look.accent, ...boardColours(canvas), dpr: look.dpr });
  const map = isFollowed && smallMap(place, frame, shown, look);
  if (map) paintMap(map, board, shown, look, soil);
}

/** Paint the whole of a followed board, and the part of it that stands on the stage.
 * @param {{canvas: HTMLCanvasElement, size: number}} map @param {{frame: Mars.Frame, trail: Cell[]}} board
 * @param {Mars.Window} shown @param {Mars.Look} look @param {Mars.Soil} soil */
function paintMap({ canvas, size }, { frame, trail }, shown, { accent, dpr }, soil) {
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d", { alpha: false }));
  paintCells(context, frame, size, soil);
  paintTrail(context, trail, size, { accent, casing: soil.casing });
  const [row, col] = frame.position;
  const side = Math.max(size, 4 * dpr);
  context.fillStyle = accent;
  context.fillRect((col + 0.5) * size - side / 2, (row + 0.5) * size - side / 2, side, side);
  const scale = size / shown.size;
  context.strokeStyle = accent;
  context.lineWidth = dpr;
  const [x, y] = [shown.left * scale, shown.top * scale];
  context.strokeRect(x + dpr / 2, y + dpr / 2, shown.width * scale - dpr, shown.height * scale - dpr);
}

/** @param {CanvasRenderingContext2D} context @param {Mars.Frame} frame @param {number} size @param {Mars.Soil} soil */
function paintCells(context, frame, size, { shades, edge, rockEdge }) {
  const gap = size >= 7 ? 1 : 0;
  context.fillStyle = shades["?"];
  context.fillRect(0, 0, frame.cols * size, frame.rows * size);
  linesOf(frame).forEach((line, row) => {
    for (const [col, length, mark] of runs(line)) {
      if (mark === "?") continue;
      context.fillStyle = mark === "#" ? shades["#"] : shades["."];
      context.fillRect(col * size, row * size, length * size, size);
      if (gap === 0) continue;
      context.fillStyle = mark === "#" ? rockEdge : edge;
      for (let k = 1; k <= length; k++) context.fillRect((col + k) * size - gap, row * size, gap, size);
      context.fillRect(col * size, (row + 1) * size - gap, length * size, gap);
    }
  });
}

/** @param {CanvasRenderingContext2D} context @param {Cell[]} trail @param {number} size
 * @param {{accent: string, casing?: string, isGhost?: boolean}} look */
function paintTrail(context, trail, size, { accent, casing, isGhost = false }) {
  if (trail.length < 2) return;
  context.beginPath();
  trail.forEach(([row, col], step) => {
    const x = (col + 0.5) * size;
    const y = (row + 0.5) * size;
    if (step === 0) context.moveTo(x, y);
    else context.lineTo(x, y);
  });
  const width = Math.max(1.5, size * 0.16);
  context.lineJoin = "round";
  context.lineCap = isGhost ? "butt" : "round";
  if (isGhost) context.setLineDash([Math.max(3, size * 0.4), Math.max(2, size * 0.3)]);
  if (casing && size >= 5) {
    context.strokeStyle = casing;
    context.globalAlpha = 0.55;
    context.lineWidth = width * 1.9;
    context.stroke();
  }
  context.strokeStyle = accent;
  context.globalAlpha = isGhost ? 0.9 : casing ? 1 : 0.8;
  context.lineWidth = width;
  context.stroke();
  context.setLineDash([]);
  context.globalAlpha = 1;
}

/** @param {CanvasRenderingContext2D} context @param {Cell} position @param {number} size
 * @param {{reach_px: number, accent: string, casing?: string, dpr: number}} look */
function paintRange(context, [row, col], size, { reach_px, accent, casing, dpr }) {
  context.beginPath();
  context.arc((col + 0.5) * size, (row + 0.5) * size, reach_px, 0, 2 * Math.PI);
  context.globalAlpha = 0.55;
  context.setLineDash([5 * dpr, 5 * dpr]);
  for (const [ink, width] of /** @type {[string, number][]} */ ([[casing ?? accent, 2 * dpr], [accent, dpr]])) {
    context.strokeStyle = ink;
    context.lineWidth = Math.max(1, width);
    context.stroke();
  }
  context.setLineDash([]);
  context.globalAlpha = 1;
}

/** @type {Record<Action, number>} */
const TURN = { north: -Math.PI / 2, east: 0, south: Math.PI / 2, west: Math.PI };

/** @param {CanvasRenderingContext2D} context @param {Mars.Frame} frame @param {number} size
 * @param {{accent: string, casing?: string, dpr: number}} look */
function paintRover(context, frame, size, { accent, casing, dpr }) {
  const [row, col] = frame.position;
  context.save();
  context.translate((col + 0.5) * size, (row + 0.5) * size);
  // On a board of many cells one cell is too small to be found, so the rover is drawn larger than its own.
  const side = casing ? Math.max(size, 7 * dpr) : size;
  if (casing) {
    context.fillStyle = casing;
    context.fillRect(-side / 2 - dpr, -side / 2 - dpr, side + 2 * dpr, side + 2 * dpr);
  }
  context.fillStyle = accent;
  context.fillRect(-side / 2, -side / 2, side, side);
  if (size >= 7) {
    context.rotate(TURN[frame.heading] ?? 0);
    context.fillStyle = "#0e0b0d";
    context.beginPath();
    context.moveTo(size * 0.32, 0);
    context.lineTo(-size * 0.22, size * 0.26);
    context.lineTo(-size * 0.22, -size * 0.26);
    context.fill();
  }
  context.restore();
}

/** @param {Mars.Frame} frame @returns whether its last move hit a rock, or led over the edge */
const hasCrashed = ({ outcome }) => outcome === "collided" || outcome === "out_of_bounds";

/** Return where a crash is marked: on the rock that was hit, or where the rover left the map, whole on the board.
 * @param {Mars.Frame} frame @param {number} size cell @param {number} radius of the mark, both device pixels @returns {Point} */
export function crashPlace({ position, heading, rows, cols }, size, radius) {
  const [row, col] = cellAfter(position, heading);
  const within = (/** @type {number} */ at, /** @type {number} */ end) => Math.min(Math.max(at, radius), end - radius);
  return { x: within((col + 0.5) * size, cols * size), y: within((row + 0.5) * size, rows * size) };
}

/** Mark where the rover was lost: a cross on a disc.
 * @param {CanvasRenderingContext2D} context @param {Mars.Frame} frame @param {number} size @param {{colour: string, dpr: number}} look */
function paintCrash(context, frame, size, { colour, dpr }) {
  const radius = Math.max(5.5 * dpr, 0.46 * size);
  const { x, y } = crashPlace(frame, size, radius + dpr);
  context.beginPath();
  context.arc(x, y, radius, 0, 7);
  context.fillStyle = colour;
  context.fill();
  context.strokeStyle = "#ffffff";
  context.lineWidth = Math.max(1.5 * dpr, 0.06 * size);
  context.stroke();
  const arm = 0.45 * radius;
  context.lineWidth = Math.max(2 * dpr, 0.11 * size);
  context.lineCap = "round";
  for (const across of [-arm, arm]) {
    context.beginPath();
    context.moveTo(x - across, y - arm);
    context.lineTo(x + across, y + arm);
    context.stroke();
  }
}

/** The paper's values 0, 0.3, 1 as greys with a tint of soil; the rover (0.6) wears its board's colour, of the same lightness. */
const MARS_SHADES = { "?": "#070506", ".": "#57483f", "#": "#f4e9dc" };
/** @type {Record<string, Mars.Soil>} */
const SOILS = {
  standard: { shades: MARS_SHADES, edge: "#3a2d28", rockEdge: "#cdbfb0" },
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
