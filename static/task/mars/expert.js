// What Expert would do at a step of a replay: how sure it is of each move, as wedges round the rover, and a line in moves.
import { many } from "../../common/words.js";
import { WAYS } from "./ground.js";

/** Shares below it draw nothing. */
const LEAST = 0.02;

/** Return a triangle for each move that has a share, round (0, 0) and its tip outward; `share` is 0..1.
 * @param {readonly number[]} shares @param {number} unit_px length that stands for a cell
 * @returns {{share: number, points: [number, number][]}[]} */
export function wedges(shares, unit_px) {
  return Object.values(WAYS).flatMap(([y, x], move) => {
    const share = shares[move];
    if (!(share >= LEAST)) return [];
    const near = 0.62 * unit_px;
    const far = near + (0.35 + 1.15 * share) * unit_px;
    const half = (0.2 + 0.22 * share) * unit_px;
    /** @type {[number, number][]} */
    const points = [[x * far, y * far], [x * near - y * half, y * near + x * half], [x * near + y * half, y * near - x * half]];
    return [{ share, points }];
  });
}

/** @param {CanvasRenderingContext2D} context @param {readonly number[]} shares @param {Cell} position
 * @param {number} size cell, device pixels @param {{colour: string, dpr: number}} look */
export function paintShares(context, shares, [row, col], size, { colour, dpr }) {
  context.save();
  context.translate((col + 0.5) * size, (row + 0.5) * size);
  context.lineJoin = "round";
  for (const { share, points } of wedges(shares, Math.max(size, 9 * dpr))) {
    context.beginPath();
    points.forEach(([x, y], index) => (index === 0 ? context.moveTo(x, y) : context.lineTo(x, y)));
    context.closePath();
    context.strokeStyle = "#0e0b0d";
    context.lineWidth = 2 * dpr;
    context.stroke();
    context.globalAlpha = 0.45 + 0.55 * share;
    context.fillStyle = colour;
    context.fill();
    context.globalAlpha = 1;
  }
  context.restore();
}

/** Return what Expert would do after `step` moves of an episode, and what the next move of it cost.
 * @param {Answers.Advice} advice @param {Mars.Course} course @param {number} step */
export function adviceText({ action, needs, cost }, { actions, outcome }, step) {
  const made = actions[step];
  const end = needs === null ? "does not get there in the moves that are left" : `needs ${many(needs, "more move")} from here`;
  if (made === action) return `Expert would go ${action} too, and ${end}.`;
  const isEnd = step === actions.length - 1 && (outcome === "collided" || outcome === "out_of_bounds");
  return `Expert would go ${action} and ${end}; the move made, ${made}, ${isEnd ? "ended the episode" : costText(cost)}.`;
}
/** @param {number} cost */
function costText(cost) {
  if (cost === 0) return "cost nothing";
  return cost > 0 ? `cost ${many(cost, "move")}` : `gained ${many(-cost, "move")}, as it turned out`;
}
