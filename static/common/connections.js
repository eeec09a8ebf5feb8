// @ts-check
// The sockets of both seats: one follower a session, opened and closed as the state says.
import { askHistory } from "./messages.js";
import { follow } from "./socket.js";

/**
 * @typedef {import("./game_state.js").State} State
 * @typedef {import("./game_state.js").Seat} Seat
 */

/**
 * The socket of a session, beside the page and with its scheme.
 * @param {string} session
 * @param {string} base
 */
export function socketUrl(session, base) {
  const url = new URL(`ws/sessions/${encodeURIComponent(session)}`, base);
  url.protocol = url.protocol.replace("http", "ws");
  url.hash = url.search = "";
  return url.href;
}

/**
 * @param {{base: string, onMessage: (seat: Seat, message: import("./messages.js").FromServer) => void,
 *   onLink: (seat: Seat, link: "open" | "lost") => void, beforeRetry: (seat: Seat, session: string) => Promise<boolean>}} how
 */
export function createLinks({ base, onMessage, onLink, beforeRetry }) {
  /** @type {Map<Seat, {session: string, follower: ReturnType<typeof follow>, askedFor: unknown}>} */
  const open = new Map();
  return {
    /**
     * Follows what is seated now, and asks for the history wherever steps are missing.
     * @param {State} state
     */
    sync(state) {
      for (const seat of /** @type {const} */ (["player", "rival"])) {
        const board = state[seat];
        const known = open.get(seat);
        if (known && known.session !== board?.session) {
          known.follower.close();
          open.delete(seat);
        }
        if (!board) continue;
        const { session } = board;
        if (!open.has(seat)) {
          const follower = follow({ url: socketUrl(session, base), onMessage: (message) => onMessage(seat, message),
            onLink: (link) => onLink(seat, link), beforeRetry: () => beforeRetry(seat, session) });
          open.set(seat, { session, follower, askedFor: null });
        }
        const link = /** @type {NonNullable<ReturnType<typeof open.get>>} */ (open.get(seat));
        if (board.hasGap && link.askedFor !== board.frame && link.follower.send(askHistory())) link.askedFor = board.frame;
      }
    },
    /**
     * True when the message left.
     * @param {Seat} seat
     * @param {object} message
     */
    send: (seat, message) => open.get(seat)?.follower.send(message) ?? false,
    silence_ms: () => open.get("player")?.follower.silence_ms() ?? Infinity,
    restart() {
      for (const { follower } of open.values()) follower.restart();
    },
  };
}
