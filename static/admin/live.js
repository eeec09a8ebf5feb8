// @ts-check
// Boards that are being played: one socket each, the frames as the operator sees them, scores and all.
import { paintBoard } from "../common/board.js";
import { follow } from "../common/socket.js";
import { outcomeShort, percent, score } from "../common/words.js";
import { stageName } from "./words.js";

/**
 * @typedef {{session: string, study: string | null, label: string | null, kind: string, phase: string | null, trial: number | null, level: string}} Seat
 */
/** @typedef {{frame: import("../common/messages.js").Frame | null, trail: import("../common/messages.js").Cell[]}} Board */
/** @typedef {{figure: HTMLElement, canvas: HTMLCanvasElement, board: Board, link: ReturnType<typeof follow>, seat: Seat}} Watched */

export const MOST = 12;

/**
 * The board after a message: the path is whole again at each history.
 * @param {Board} board
 * @param {import("../common/messages.js").FromServer} message
 * @returns {Board}
 */
export function heard(board, message) {
  if (message.kind === "history" && message.episode === board.frame?.episode) return { ...board, trail: message.positions };
  if (message.kind !== "frame") return board;
  const isNew = message.episode !== board.frame?.episode;
  return { frame: message, trail: isNew ? [message.position] : message.step === board.trail.length ? [...board.trail, message.position] : board.trail };
}

/**
 * Who sits there and what is played, short.
 * @param {Seat} seat
 */
export function caption({ label, kind, phase, trial }) {
  const who = label ? `${label}${kind === "script" ? " (script)" : ""}` : kind === "script" ? "a script" : "a player";
  return [who, phase ? `${stageName(phase)}${phase === "tutorial" ? "" : ` ${(trial ?? 0) + 1}`}` : "playground"];
}

/**
 * @param {HTMLElement} place
 * @param {string} base the page's address
 */
export function createLive(place, base) {
  /** @type {Map<string, Watched>} */
  const watched = new Map();
  /** @type {Set<string>} sessions whose board the server does not know any more */
  const gone = new Set();

  /** @param {Seat} seat */
  function open(seat) {
    const figure = document.createElement("figure");
    figure.dataset.testid = `live-${seat.label ?? seat.session}`;
    figure.dataset.outcome = "";
    const canvas = document.createElement("canvas");
    canvas.setAttribute("role", "img");
    const matrix = Object.assign(document.createElement("div"), { className: "matrix" });
    matrix.append(canvas);
    figure.append(matrix, document.createElement("figcaption"));
    const url = new URL(`ws/admin/sessions/${encodeURIComponent(seat.session)}`, base);
    url.protocol = url.protocol.replace("http", "ws");
    url.hash = "";
    /** @type {Watched} */
    const one = { figure, canvas, seat, board: { frame: null, trail: [] }, link: follow({
      url: url.href, onLink: () => {}, beforeRetry: async () => watched.has(seat.session),
      onMessage: (message) => { one.board = heard(one.board, message); paint(one); },
    }) };
    place.append(figure);
    watched.set(seat.session, one);
    return one;
  }
  /** @param {Watched} one */
  function paint({ figure, canvas, board: { frame, trail }, seat }) {
    const [who, what] = caption(seat);
    const numbers = frame ? `${frame.step} moves \u00b7 ${percent(frame.coverage)} % \u00b7 ${frame.score === null ? "" : score(frame.score)}${frame.outcome ? ` \u00b7 ${outcomeShort(frame.outcome)}` : ""}` : "";
    const parts = [["b", who, ""], ["span", what, ""], ["span", numbers, "numbers"]].map(([kind, textContent, className]) => Object.assign(document.createElement(kind), { textContent, className }));
    /** @type {HTMLElement} */ (figure.querySelector("figcaption")).replaceChildren(...parts);
    if (!frame) return;
    figure.dataset.outcome = frame.outcome ?? "";
    canvas.setAttribute("aria-label", `Board of ${who}, ${what}: ${percent(frame.coverage)} percent explored after ${frame.step} moves`);
    const { width } = /** @type {HTMLElement} */ (canvas.parentElement).getBoundingClientRect();
    const accent = getComputedStyle(document.documentElement).getPropertyValue(seat.kind === "script" ? "--rival" : "--accent").trim();
    paintBoard(canvas, { frame, trail }, { accent, width_px: width, height_px: width, dpr: window.devicePixelRatio || 1 });
  }
  return {
    /**
     * Watches these, and no others.
     * @param {Seat[]} seats
     */
    sync(seats) {
      const wanted = seats.filter(({ session }) => !gone.has(session)).slice(0, MOST);
      const sessions = new Set(wanted.map(({ session }) => session));
      for (const [session, one] of watched) {
        if (sessions.has(session)) continue;
        watched.delete(session);
        one.link.close();
        one.figure.remove();
      }
      for (const seat of wanted) {
        const one = watched.get(seat.session) ?? open(seat);
        one.seat = seat;
        paint(one);
      }
    },
    count: () => watched.size,
  };
}
