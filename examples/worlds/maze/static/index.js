// The maze on the page: a picture of its cells, and its own words; all else is as for any environment that is shown as text.
import { create, reader } from "../../common/page.js";
import { many } from "../../common/words.js";
import { taskOf as textOf } from "../picture/index.js";

/** @typedef {Picture.Frame} Frame @typedef {[number, number]} Cell */

/** @param {Frame} frame @returns {string[]} the rows of cells: `@` you, `.` free, `#` a wall, `?` not seen yet */
const rowsOf = ({ text }) => (text ?? "").split("\n");

/** @param {Frame} frame @returns {Cell} where the player stands */
function placeOf(frame) {
  const rows = rowsOf(frame);
  const row = rows.findIndex((cells) => cells.includes("@"));
  return [row, rows[row].indexOf("@")];
}

/** @param {Frame} frame */
const shapeOf = (frame) => /** @type {Cell} */ ([rowsOf(frame)[0].length, rowsOf(frame).length]);

/** @param {CanvasRenderingContext2D} context @param {Cell[]} trail @param {number} size of a cell, device pixels
 * @param {string} colour @param {boolean} isDashed */
function paintTrail(context, trail, size, colour, isDashed) {
  context.beginPath();
  for (const [row, col] of trail) context.lineTo((col + 0.5) * size, (row + 0.5) * size);
  context.strokeStyle = colour;
  context.lineWidth = Math.max(2, size * 0.12);
  context.lineJoin = context.lineCap = "round";
  context.setLineDash(isDashed ? [size * 0.3, size * 0.3] : []);
  context.stroke();
  context.setLineDash([]);
}

/** @param {CanvasRenderingContext2D} context @param {Cell} cell @param {number} size @param {string} colour @param {number} share */
function paintDisc(context, [row, col], size, colour, share) {
  context.beginPath();
  context.arc((col + 0.5) * size, (row + 0.5) * size, share * size, 0, 2 * Math.PI);
  context.fillStyle = colour;
  context.fill();
}

/** Draw the cells, the way that was gone, the goal and the player.
 * @param {HTMLElement} place @param {{frame: Frame, trail: Cell[]}} board @param {Look} look */
function paint(place, { frame, trail }, { name, accent, width_px, height_px, dpr, ghost }) {
  const canvas = place.querySelector("canvas") ?? place.appendChild(create("canvas", [], { role: "img" }));
  const [cols, rows] = shapeOf(frame);
  const size = Math.max(1, Math.floor((Math.min(width_px / cols, height_px / rows) || 1) * dpr));
  canvas.hidden = false;
  Object.assign(canvas, { width: cols * size, height: rows * size });
  Object.assign(canvas.style, { width: `${canvas.width / dpr}px`, height: `${canvas.height / dpr}px` });
  canvas.setAttribute("aria-label", `${name}: ${inWords(frame).line}`);
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  const read = reader(place);
  /** @type {Record<string, string>} */
  const colours = { "?": read("--board-unknown"), "#": read("--board-rock") };
  rowsOf(frame).forEach((cells, row) => [...cells].forEach((cell, col) => {
    context.fillStyle = colours[cell] ?? read("--board-ground");
    context.fillRect(col * size, row * size, size, size);
  }));
  paintDisc(context, [rows - 1, cols - 1], size, read("--board-better"), 0.3);
  if (ghost) paintTrail(context, /** @type {Cell[]} */ (ghost.trail), size, ghost.accent, true);
  paintTrail(context, trail, size, accent, false);
  paintDisc(context, placeOf(frame), size, accent, 0.36);
}

const ENDS = {
  succeeded: ["Reached the goal in", "That is the lower right corner."],
  timed_out: ["Out of moves after", "The last move was made before the goal was reached."],
  abandoned: ["Left after", "The maze was left before its end."],
};

/** @param {Frame} frame */
function ending({ outcome, step }) {
  const [title, line] = /** @type {Record<string, string[]>} */ (ENDS)[outcome ?? ""] ?? ["After", ""];
  return { title: `${title} ${many(step, "move")}`, line };
}

/** @param {Frame} frame */
function inWords(frame) {
  const [row, col] = placeOf(frame);
  const unseen = rowsOf(frame).join("").split("?").length - 1;
  const line = `row ${row + 1}, column ${col + 1} after ${many(frame.step, "move")}; ${many(unseen, "cell")} not seen yet`;
  return { line, rows: rowsOf(frame) };
}

/** @param {Answers.Task} about @returns {TaskOf<Frame, Cell, Picture.Course, Picture.History & {cells: Cell[]}>} */
export function taskOf(about) {
  const text = textOf(about);
  return {
    ...text, paint, inWords, ending,
    nameOf: (policy) => ({ "far-wall": "Far Wall", random: "Random" })[policy] ?? policy,
    round: "maze", target: "the goal", mark: placeOf, shape: shapeOf,
    place: (_, frame) => `Maze \u00b7 ${shapeOf(frame).join(" \u00d7 ")}`,
    path: ({ headlines, cells }) => ({ trail: cells, progress: headlines.map((value) => value ?? 0) }),
    goal: () => "Find the way to the green goal in as few moves as you can",
    standing: "You see what lies beside the cells that you have stood on.",
    outcome: (outcome) => ({ succeeded: "at the goal", timed_out: "out of moves", abandoned: "left" })[outcome ?? ""] ?? "",
    trialEnding: (frame, target) => ({ ...text.trialEnding(frame, target), ...ending(frame) }),
    announcement(before, after) {
      if (before?.episode !== after.episode) return "New maze.";
      return after.outcome && !before.outcome ? `${ending(after).title}.` : "";
    },
    sound: (_, { outcome }) => (outcome ? { kind: outcome === "succeeded" ? "finish" : "over" } : null),
    boardAt(course, step) {
      const frames = course.frames.filter((frame) => frame.step <= step);
      return { frame: frames[frames.length - 1], trail: frames.map(placeOf) };
    },
  };
}
