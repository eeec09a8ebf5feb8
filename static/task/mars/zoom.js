// How much of a large board stands on the stage: cells that can be told apart round the rover, which is followed, and the whole in a
// small map. A wheel, two fingers, + and - change it for all boards of the page.
import { ownsKeys } from "../../common/keyboard.js";
import { create } from "../../common/page.js";

/** A board with a longer side, cells, is followed: in 3-D until somebody chooses (viewer3d/scene.py), in the matrix where it does not fit. */
export const LARGE_SIDE = 21;
/** No cell is smaller, CSS pixels. */
export const LEAST_PX = 10;
/** A cell of a board whose cells would be smaller than that, until somebody zooms. */
const FIRST_PX = 12;
const MOST_PX = 48;
/** What + or - changes. */
const STEP = 1.25;
/** Of the small map, in CSS pixels and as a share of the stage. */
const MAP = Object.freeze({ least_px: 64, most_px: 150, share: 0.3, margin_px: 14 });

/** @type {number | null} a cell as it was chosen, CSS pixels */
let chosen_px = null;
/** @type {Map<HTMLElement, {cell_px: number, repaint: () => void}>} the boards that are followed, with a cell of each */
const followed = new Map();
/** @type {WeakSet<HTMLElement>} the stages whose gestures are heard */
const heard = new WeakSet();

/** Return how large a cell is, and which part of the board stands on the stage, in device pixels.
 * @param {{rows: number, cols: number, position: Cell}} frame
 * @param {{width_px: number, height_px: number, dpr: number}} room @param {number} fit a cell of the whole board
 * @param {number | null} wanted_px a cell as it was chosen, CSS pixels @returns {Mars.Window} */
export function windowOf({ rows, cols, position: [row, col] }, { width_px, height_px, dpr }, fit, wanted_px) {
  const least = Math.max(fit, Math.ceil(LEAST_PX * dpr));
  const first = fit >= LEAST_PX * dpr ? fit : FIRST_PX * dpr;
  const wanted = wanted_px === null ? first : wanted_px * dpr;
  const size = Math.round(Math.min(Math.max(wanted, least), Math.max(least, MOST_PX * dpr)));
  const width = Math.min(cols * size, Math.floor(width_px * dpr));
  const height = Math.min(rows * size, Math.floor(height_px * dpr));
  const clamped = (/** @type {number} */ start, /** @type {number} */ most) => Math.round(Math.max(0, Math.min(start, most)));
  return { size, width, height,
    left: clamped((col + 0.5) * size - width / 2, cols * size - width), top: clamped((row + 0.5) * size - height / 2, rows * size - height) };
}

/** Return the factor, at most 1, by which a board shrinks that has more cells than its room has device pixels.
 * @param {number} room_width_px @param {number} room_height_px @param {number} width_px @param {number} height_px */
export const shrunkTo = (room_width_px, room_height_px, width_px, height_px) => Math.min(1, room_width_px / width_px, room_height_px / height_px);

/** Follow the rover of a board on its stage.
 * @param {HTMLElement} place @param {Mars.Frame} frame @param {Mars.Look} look @param {number} fit a cell of the whole board
 * @param {() => void} repaint @returns {Mars.Window} what stands there, in device pixels */
export function follow(place, frame, look, fit, repaint) {
  const shown = windowOf(frame, look, fit, chosen_px);
  if (!heard.has(place)) hear(place);
  const cell_px = shown.size / look.dpr;
  followed.set(place, { cell_px, repaint });
  place.dataset.cell = String(cell_px);
  return shown;
}

/** @param {HTMLElement} place whose board stands there whole from now on */
export function release(place) {
  followed.delete(place);
  place.classList.remove("is-zoomed");
  place.querySelector(".whole-map")?.remove();
}

/** @param {number} cell_px */
function choose(cell_px) {
  chosen_px = Math.max(LEAST_PX, Math.min(MOST_PX, cell_px));
  for (const { repaint } of [...followed.values()]) repaint();
}
/** @returns {number} a cell on the stages, CSS pixels, with the part of a pixel that was chosen */
function cellNow() {
  const cell_px = Math.max(...[...followed.values()].map((board) => board.cell_px));
  return chosen_px !== null && Math.abs(chosen_px - cell_px) < 1 ? chosen_px : cell_px;
}

/** @param {HTMLElement} place */
function hear(place) {
  heard.add(place);
  document.addEventListener("keydown", onKey); // the same listener is added once
  place.addEventListener("wheel", (event) => {
    if (!followed.has(place) || !(event.ctrlKey || place.classList.contains("is-zoomed"))) return; // the page scrolls
    event.preventDefault();
    choose(cellNow() * 1.0015 ** -event.deltaY);
  }, { passive: false });
  /** @type {Map<number, Point>} */
  const fingers = new Map();
  let begun = { apart_px: 0, cell_px: 0 };
  const apart_px = () => {
    const [one, other] = [...fingers.values()];
    return Math.hypot(one.x - other.x, one.y - other.y);
  };
  // before the board's own listeners, which swallow swipes
  for (const type of /** @type {const} */ (["pointerdown", "pointermove", "pointerup", "pointercancel"])) {
    document.addEventListener(type, (event) => {
      if (event.pointerType !== "touch") return;
      if (type === "pointerdown" && place.contains(/** @type {Node} */ (event.target))) fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
      else if (!fingers.has(event.pointerId)) return;
      else if (type === "pointermove") fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
      else fingers.delete(event.pointerId);
      if (fingers.size !== 2 || !followed.has(place)) return;
      if (type !== "pointermove") begun = { apart_px: apart_px(), cell_px: cellNow() };
      else if (begun.apart_px > 0) choose(begun.cell_px * (apart_px() / begun.apart_px));
    }, true);
  }
}

/** @param {KeyboardEvent} event */
function onKey(event) {
  const way = /^[+=]$/.test(event.key) ? STEP : /^[-_\u2212]$/.test(event.key) ? 1 / STEP : 0;
  if (!way || event.ctrlKey || event.metaKey || event.altKey || ownsKeys(/** @type {HTMLElement} */ (event.target)) || document.querySelector("dialog[open]")) return;
  if (followed.size === 0) return;
  event.preventDefault();
  choose(cellNow() * way);
}

/** Return the canvas of the small map on a stage, placed where the rover is not; null where the whole board stands there.
 * @param {HTMLElement} place @param {{rows: number, cols: number, position: Cell}} frame @param {Mars.Window} shown
 * @param {Mars.Look} look @returns {{canvas: HTMLCanvasElement, size: number} | null} with its cell in device pixels */
export function smallMap(place, { rows, cols, position: [row, col] }, shown, { width_px, height_px, dpr }) {
  const isWhole = shown.width >= cols * shown.size && shown.height >= rows * shown.size;
  let canvas = /** @type {HTMLCanvasElement | null} */ (place.querySelector(".whole-map"));
  place.classList.toggle("is-zoomed", !isWhole);
  if (isWhole) {
    canvas?.remove();
    return null;
  }
  if (!canvas) place.append(canvas = create("canvas", [], { class: "whole-map", "aria-hidden": "true" }));
  const side_px = Math.max(MAP.least_px, Math.min(MAP.most_px, MAP.share * Math.min(width_px, height_px)));
  const size = Math.max(1, Math.round((side_px * dpr) / Math.max(rows, cols)));
  if (canvas.width !== cols * size || canvas.height !== rows * size) Object.assign(canvas, { width: cols * size, height: rows * size });
  const shrunk = size > 1 ? 1 : shrunkTo(side_px, side_px, cols / dpr, rows / dpr);
  const [width, height] = [shrunk * cols * size, shrunk * rows * size];
  Object.assign(canvas.style, { width: `${width / dpr}px`, height: `${height / dpr}px` });
  const [x, y] = [(col + 0.5) * shown.size - shown.left, (row + 0.5) * shown.size - shown.top];
  const reach = 2 * shown.size + MAP.margin_px * dpr;
  const isUnder = y < height + reach && x > shown.width - width - reach;
  place.dataset.map = isUnder ? "south" : "north";
  return { canvas, size };
}
