// The pictures of the page about the rules: real boards, painted as on the playground.
import { boardColours } from "../../common/page.js";
import { many } from "../../common/words.js";
import { paint } from "./board.js";

/** @param {Record<string, {actions: number[], coverage: number, trail: Cell[], frame: Mars.Frame}>} boards */
function paintAll(boards) {
  const { you, policy } = boardColours(document.documentElement);
  for (const canvas of /** @type {NodeListOf<HTMLCanvasElement>} */ (document.querySelectorAll("[data-board]"))) {
    const name = canvas.dataset.board ?? "";
    const board = boards[name];
    if (!board) continue;
    canvas.style.width = "";
    const place = /** @type {HTMLElement} */ (canvas.parentElement);
    const side = { width_px: place.clientWidth, height_px: place.clientWidth };
    paint(place, board, { name, accent: name === "crash" ? you : policy, ...side, dpr: window.devicePixelRatio || 1 });
    const line = boardLine(name, board);
    canvas.setAttribute("aria-label", line);
    const says = document.querySelector(`[data-says=${name}]`);
    if (says) says.textContent = line;
  }
}

/** @param {string} name start, way, done or crash @param {{actions: unknown[], coverage: number}} board @returns the sentence about a board */
export function boardLine(name, { actions, coverage }) {
  const percent = `${Math.floor(100 * coverage)}\u00a0%`;
  const moves = many(actions.length, "move");
  if (name === "start") return `The lidar shows the first ${percent} before any move.`;
  if (name === "done") return `${percent} is known after ${moves}.`;
  if (name === "crash") return `Crashed at ${percent} after ${moves}.`;
  return `${percent} is known after ${moves}. The line is the path.`;
}

if (globalThis.document) {
  const { boards } = await (await fetch(new URL("../../about/boards.json", import.meta.url))).json();
  new ResizeObserver(() => paintAll(boards)).observe(document.body);
}
