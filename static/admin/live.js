// Boards that are being played: one socket each, with the frames that the operator may see.
import { boardOf, received } from "../common/game_state.js";
import { follow, socketUrl } from "../common/socket.js";
import { create } from "../common/page.js";
import { loadTask } from "../common/task.js";
import { many, score } from "../common/words.js";
import { stageName } from "./words.js";

export const MAX_BOARDS = 12;

/** @param {Task} task @param {Board | null} board @param {FromServer} message @returns the board after a message */
export const boardAfter = (task, board, message) =>
  (board || message.kind !== "frame" ? received(task, board, message) : boardOf(task, "", "", message, null));

/** @param {Admin.LiveBoard} info @returns who plays and what is played, in short */
export function caption({ label, kind, phase, trial }) {
  const who = label ? `${label}${kind === "script" ? " (script)" : ""}` : kind === "script" ? "a script" : "a player";
  return [who, phase ? `${stageName(phase)}${phase === "tutorial" ? "" : ` ${(trial ?? 0) + 1}`}` : "playground"];
}

/** A board on the page.
 * @typedef {{figure: HTMLElement, canvas: HTMLCanvasElement, board: Board | null, task: Task | null,
 *   link: ReturnType<typeof follow>, info: Admin.LiveBoard}} Watched */

/** @param {HTMLElement} place */
export function createLive(place) {
  /** @type {Map<string, Watched>} */
  const watched = new Map();

  /** @param {Admin.LiveBoard} info */
  function open(info) {
    const canvas = create("canvas", [], { role: "img" });
    const figure = create("figure", [create("div", canvas, { class: "matrix" }), create("figcaption")],
      { "data-testid": `live-${info.label ?? info.session}`, "data-outcome": "" });
    /** @type {Watched} */
    const one = { figure, canvas, info, board: null, task: null, link: follow({
      url: socketUrl(info.session, "ws/admin/sessions"), onLink: () => {}, beforeRetry: async () => watched.has(info.session),
      async onMessage(message) {
        one.task ??= await loadTask();
        one.board = boardAfter(one.task, one.board, message);
        paint(one);
      },
    }) };
    place.append(figure);
    watched.set(info.session, one);
    return one;
  }
  /** @param {Watched} one */
  function paint({ figure, canvas, board, task, info }) {
    const [who, what] = caption(info);
    /** @param {string} numbers */
    const say = (numbers) => figure.querySelector("figcaption")?.replaceChildren(create("b", who), create("span", what), create("span", numbers, { class: "numbers" }));
    if (!board || !task) return void say("");
    const { step, outcome, score: scored } = board.frame;
    const { value, unit } = task.headline(board.frame);
    say([many(step, "move"), `${value} ${unit.split(" ")[0]}`, scored === null ? "" : score(scored), outcome ? task.status(outcome) : ""].filter(Boolean).join(" \u00b7 "));
    figure.dataset.outcome = outcome ?? "";
    const place = /** @type {HTMLElement} */ (canvas.parentElement);
    const { width } = place.getBoundingClientRect();
    const accent = getComputedStyle(document.documentElement).getPropertyValue(info.kind === "script" ? "--board-policy" : "--board-you").trim();
    task.paint(place, board, { name: "", accent, width_px: width, height_px: width, dpr: window.devicePixelRatio || 1 });
    canvas.setAttribute("aria-label", `Board of ${who}, ${what}: ${value} ${unit} after ${many(step, "move")}`);
  }
  return {
    /** Watch these boards, and no others.
     * @param {Admin.LiveBoard[]} infos */
    sync(infos) {
      const wanted = infos.slice(0, MAX_BOARDS);
      const sessions = new Set(wanted.map(({ session }) => session));
      for (const [session, one] of watched) {
        if (sessions.has(session)) continue;
        watched.delete(session);
        one.link.close();
        one.figure.remove();
      }
      for (const info of wanted) {
        const one = watched.get(info.session) ?? open(info);
        one.info = info;
        paint(one);
      }
    },
    count: () => watched.size,
  };
}
