// @ts-check
// The sockets of both boards: one follower for each session, opened and closed as the state says.
import { askHistory } from "./messages.js";
import { follow } from "./socket.js";

/** Return the address of a session's socket, below the page's own and with its scheme.
 * @param {string} session @param {string} base @param {string} [folder] of the sockets */
export function socketUrl(session, base, folder = "ws/sessions") {
  const url = new URL(`${folder}/${encodeURIComponent(session)}`, base);
  url.protocol = url.protocol.replace("http", "ws");
  url.hash = url.search = "";
  return url.href;
}

/** @param {{base: string, onMessage: (role: Role, message: FromServer) => void, onLink: (role: Role, link: "open" |
 *   "lost") => void, beforeRetry: (role: Role, session: string) => Promise<boolean>}} how */
export function createConnections({ base, onMessage, onLink, beforeRetry }) {
  /** @type {Map<Role, {session: string, follower: ReturnType<typeof follow>, askedFor: unknown}>} */
  const open = new Map();
  return {
    /** Follow the sessions of the boards, and ask for the history wherever steps are missing.
     * @param {GameState} state */
    sync(state) {
      for (const role of /** @type {const} */ (["player", "rival"])) {
        const board = state[role];
        const known = open.get(role);
        if (known && known.session !== board?.session) {
          known.follower.close();
          open.delete(role);
        }
        if (!board) continue;
        const { session } = board;
        if (!open.has(role)) {
          const follower = follow({ url: socketUrl(session, base), onMessage: (message) => onMessage(role, message),
            onLink: (link) => onLink(role, link), beforeRetry: () => beforeRetry(role, session) });
          open.set(role, { session, follower, askedFor: null });
        }
        const link = /** @type {NonNullable<ReturnType<typeof open.get>>} */ (open.get(role));
        if (board.hasGap && link.askedFor !== board.frame && link.follower.send(askHistory())) link.askedFor = board.frame;
      }
    },
    /** Send a message; return whether it left.
     * @param {Role} role @param {object} message */
    send: (role, message) => open.get(role)?.follower.send(message) ?? false,
    silence_ms: () => open.get("player")?.follower.silence_ms() ?? Infinity,
    restart() {
      for (const { follower } of open.values()) follower.restart();
    },
    /** Find out whether the sockets still answer, and start those again that do not. */
    check() {
      for (const { follower } of open.values()) follower.check();
    },
  };
}
