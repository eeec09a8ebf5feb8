// @ts-check
// The pictures of the page about the rules: real boards, painted as on the playground.
import { paintBoard } from "../common/board.js";
import { boardColours } from "../common/colours.js";
import { boardLine } from "./words.js";

/** @type {Record<string, PaintedBoard>} */
let boards = {};

function paint() {
  const { soil, you, policy } = boardColours(document.documentElement);
  for (const canvas of /** @type {NodeListOf<HTMLCanvasElement>} */ (document.querySelectorAll("[data-board]"))) {
    const name = canvas.dataset.board ?? "";
    const board = boards[name];
    if (!board) continue;
    canvas.style.width = "";
    const side_px = /** @type {HTMLElement} */ (canvas.parentElement).clientWidth;
    paintBoard(canvas, board, { soil, accent: name === "crash" ? you : policy, width_px: side_px, height_px: side_px, dpr: window.devicePixelRatio || 1 });
    const line = boardLine(name, board);
    canvas.setAttribute("aria-label", line);
    const says = document.querySelector(`[data-says=${name}]`);
    if (says) says.textContent = line;
  }
}

boards = (await (await fetch("static/about/boards.json")).json()).boards;
new ResizeObserver(paint).observe(document.body);
