// @ts-check
// Boards that are being played: one socket each, with the frames that the operator may see, scores included.
import { paintBoard } from "../common/board.js";
import { follow, socketUrl } from "../common/socket.js";
import { create } from "../common/page.js";
import { outcomeShort, percent, score } from "../common/words.js";
import { stageName } from "./words.js";

export const MAX_BOARDS = 12;

/** Return the board after a message. A history makes its path whole again.
 * @param {Admin.WatchedBoard} board @param {FromServer} message @returns {Admin.WatchedBoard} */
export function boardAfter(board, message) {
  if (message.kind === "history" && message.episode === board.frame?.episode) return { ...board, trail: message.positions };
  if (message.kind !== "frame") return board;
  const isNew = message.episode !== board.frame?.episode;
  return { frame: message, trail: isNew ? [message.position] : message.step === board.trail.length ? [...board.trail, message.position] : board.trail };
}

/** @param {Admin.BoardInfo} info @returns who plays and what is played, in short */
export function caption({ label, kind, phase, trial }) {
  const who = label ? `${label}${kind === "script" ? " (script)" : ""}` : kind === "script" ? "a script" : "a player";
  return [who, phase ? `${stageName(phase)}${phase === "tutorial" ? "" : ` ${(trial ?? 0) + 1}`}` : "playground"];
}

/** @param {HTMLElement} place @param {string} base the page's address */
export function createLive(place, base) {
  /** @type {Map<string, Admin.Watched>} */
  const watched = new Map();

  /** @param {Admin.BoardInfo} info */
  function open(info) {
    const canvas = create("canvas", [], { role: "img" });
    const figure = create("figure", [create("div", canvas, { class: "matrix" }), create("figcaption")],
      { "data-testid": `live-${info.label ?? info.session}`, "data-outcome": "" });
    /** @type {Admin.Watched} */
    const one = { figure, canvas, info, board: { frame: null, trail: [] }, link: follow({
      url: socketUrl(info.session, base, "ws/admin/sessions"), onLink: () => {}, beforeRetry: async () => watched.has(info.session),
      onMessage: (message) => { one.board = boardAfter(one.board, message); paint(one); },
    }) };
    place.append(figure);
    watched.set(info.session, one);
    return one;
  }
  /** @param {Admin.Watched} one */
  function paint({ figure, canvas, board: { frame, trail }, info }) {
    const [who, what] = caption(info);
    const numbers = frame ? [`${frame.step} moves`, `${percent(frame.coverage)} %`, frame.score === null ? "" : score(frame.score), frame.outcome ? outcomeShort(frame.outcome) : ""].filter(Boolean).join(" \u00b7 ") : "";
    figure.querySelector("figcaption")?.replaceChildren(create("b", who), create("span", what), create("span", numbers, { class: "numbers" }));
    if (!frame) return;
    figure.dataset.outcome = frame.outcome ?? "";
    canvas.setAttribute("aria-label", `Board of ${who}, ${what}: ${percent(frame.coverage)} percent explored after ${frame.step} moves`);
    const { width } = /** @type {HTMLElement} */ (canvas.parentElement).getBoundingClientRect();
    const accent = getComputedStyle(document.documentElement).getPropertyValue(info.kind === "script" ? "--board-policy" : "--board-you").trim();
    paintBoard(canvas, { frame, trail }, { accent, width_px: width, height_px: width, dpr: window.devicePixelRatio || 1 });
  }
  return {
    /** Watch these boards, and no others.
     * @param {Admin.BoardInfo[]} infos */
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
