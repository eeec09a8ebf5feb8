// One session's socket, which heals itself: it reports every message and its own health, and reconnects with growing waits.
import { api, ROOT } from "./api.js";
import { askHistory, parse } from "./messages.js";
import { HELD_BACK_TEXT } from "./words.js";

/** How long a socket has to answer before it is taken for lost, ms. */
const ANSWER_MS = 1500;

/** After so many sockets that did not open, while the server answers otherwise, something between holds them back. */
const HELD_BACK = 2;

/** @param {number} attempt counted from 0 @returns the wait before attempt k, in ms: 250, 500, ... at most 5,000 */
export const backoff_ms = (attempt) => Math.min(5000, 250 * 2 ** attempt);

/** Follow a session until `close`.
 *   onLink       "open" once joined, "lost" the moment it breaks
 *   beforeRetry  asked before each new attempt; it answers false when the session is gone for good
 *   onHeldBack   the server answers, and yet no socket has opened so many times
 * @param {{url: string, onMessage: (message: FromServer) => void, onLink: (link: "open" | "lost") => void,
 *   beforeRetry: () => Promise<boolean>, onHeldBack?: () => void}} how */
export function follow({ url, onMessage, onLink, beforeRetry, onHeldBack }) {
  /** @type {WebSocket | null} */
  let socket = null;
  let attempt = 0;
  let unopened = 0; // sockets in a row that closed before they opened
  let round = 0;
  let isClosed = false;
  let timer = 0;
  let doubt = 0; // the timer of a socket that has to show that it still works

  function connect() {
    if (isClosed) return;
    const mine = new WebSocket(url);
    socket = mine;
    mine.onmessage = (event) => {
      attempt = 0;
      if (doubt && mine === socket) {
        endDoubt();
        onLink("open");
      }
      const message = parse(event.data);
      if (message && mine === socket) onMessage(message);
    };
    let hasOpened = false;
    mine.onopen = () => {
      if (mine !== socket) return;
      hasOpened = true;
      unopened = 0;
      onLink("open");
    };
    mine.onclose = () => {
      if (mine !== socket) return;
      if (!hasOpened) unopened += 1;
      retry();
    };
  }
  function retry() {
    if (isClosed) return;
    socket = null;
    onLink("lost");
    clearTimeout(timer);
    const mine = ++round;
    timer = setTimeout(async () => {
      const mayRetry = await beforeRetry().catch(() => null);
      if (isClosed || mine !== round || mayRetry === false) return; // another round began meanwhile: one socket, not two
      if (mayRetry === null) {
        unopened = 0; // no server answers at all
        return retry();
      }
      if (unopened >= HELD_BACK) onHeldBack?.();
      connect();
    }, backoff_ms(attempt++));
  }
  function endDoubt() {
    clearTimeout(doubt);
    doubt = 0;
  }
  function restart() {
    const old = socket;
    socket = null;
    endDoubt();
    old?.close();
    attempt = 0;
    retry();
  }
  connect();
  return {
    /** Send a message; return whether it left.
     * @param {object} message */
    send(message) {
      if (socket?.readyState !== WebSocket.OPEN) return false;
      socket.send(JSON.stringify(message));
      return true;
    },
    /** Drop the present socket and start again at once: the network says that it is back. */
    restart,
    /** Find out whether the socket still answers, now that the server does after a silence. It was only slow, and
     * nothing is lost, or the socket is started again. */
    check() {
      const asked = socket;
      if (asked?.readyState !== WebSocket.OPEN) return restart();
      asked.send(JSON.stringify(askHistory()));
      clearTimeout(doubt);
      doubt = setTimeout(() => { if (asked === socket && !isClosed) restart(); }, ANSWER_MS);
    },
    close() {
      isClosed = true;
      clearTimeout(timer);
      socket?.close();
    },
  };
}

/** Return the address of a session's socket, below the app's own and with its scheme.
 * @param {string} session @param {string} [folder] of the sockets @param {string} [root] of the app */
export function socketUrl(session, folder = "ws/sessions", root = ROOT) {
  const url = new URL(`${folder}/${encodeURIComponent(session)}`, root);
  url.protocol = url.protocol.replace("http", "ws");
  url.hash = url.search = "";
  return url.href;
}

/** How long an answer may take, and how far apart the questions of a lost connection are, ms. */
const DUE_MS = 1000;

/** Ask api/health while an answer is overdue or the connection is lost: a socket that broke says so itself, a network that
 * went silent does not. While the socket is open and nothing is due, nothing is asked.
 *   waited_ms    ms for which the server has owed an answer; Infinity while the connection is lost
 *   onFailure    called with the number of failures in a row
 *   onSuccess    called when an answer came after a failure
 * @param {{waited_ms: () => number, onFailure: (inARow: number) => void, onSuccess: () => void}} how */
export function startHeartbeat({ waited_ms, onFailure, onSuccess }) {
  let failures = 0;
  let isAsking = false;
  let askedAt_ms = 0;
  return setInterval(async () => {
    if (isAsking || document.hidden || (failures === 0 && waited_ms() < DUE_MS) || performance.now() - askedAt_ms < DUE_MS) return;
    isAsking = true;
    askedAt_ms = performance.now();
    try {
      await api.health();
      if (failures > 0) onSuccess();
      failures = 0;
    } catch {
      failures += 1;
      onFailure(failures);
    }
    isAsking = false;
  }, 250);
}

/** Connect the boards of a page, and find out when the connection is lost and when it is back.
 *   onAnswered  the moves that a message of the player's board answers
 *   onBack      the server answers again
 * @param {{moves: {receive: (message: FromServer) => Pending[], drop: () => void},
 *   telemetry: Pick<Telemetry, "answered" | "reconnected" | "look">,
 *   dispatch: (event: GameEvent) => void, isLost: () => boolean,
 *   onAnswered?: (moves: Pending[], message: FromServer) => void, onBack?: () => void, beforeRetry: (role: Role, session: string) => Promise<boolean>}} how */
export function startBoards({ moves, telemetry, dispatch, isLost, onAnswered, onBack, beforeRetry }) {
  /** When the oldest message left that nothing has followed yet. */
  let owedSince_ms = Infinity;
  /** @type {Map<Role, {session: string, follower: ReturnType<typeof follow>, askedFor: unknown}>} */
  const open = new Map();
  /** @param {Role} role @param {FromServer} message */
  function onMessage(role, message) {
    if (role === "player") {
      owedSince_ms = Infinity;
      const answered = moves.receive(message);
      if (answered.length) dispatch({ kind: "moved" });
      onAnswered?.(answered, message);
    }
    if (message.kind === "kept") telemetry.answered(message);
    else dispatch({ kind: "received", role, message });
    telemetry.look();
  }
  /** @param {Role} role @param {"open" | "lost"} link */
  function onLink(role, link) {
    if (link === "lost") moves.drop();
    if (role !== "player") return;
    if (link === "open") telemetry.reconnected();
    dispatch({ kind: "link", link });
    if (link === "open") dispatch({ kind: "dismiss", text: HELD_BACK_TEXT });
  }
  const onHeldBack = () => dispatch({ kind: "notice", text: HELD_BACK_TEXT });
  const restart = () => open.forEach(({ follower }) => follower.restart());
  startHeartbeat({
    waited_ms: () => (isLost() ? Infinity : performance.now() - owedSince_ms),
    onSuccess() {
      owedSince_ms = Infinity;
      if (!isLost()) return;
      open.forEach(({ follower }) => follower.check());
      onBack?.();
    },
    onFailure() {
      moves.drop();
      dispatch({ kind: "link", link: "lost" });
    },
  });
  addEventListener("offline", () => {
    dispatch({ kind: "link", link: "lost" });
    open.forEach(({ follower }) => follower.check()); // one on this machine or near it may answer all the same
  });
  addEventListener("online", restart);
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
        if (!board?.session) continue;
        const { session } = board;
        if (!open.has(role)) {
          const follower = follow({ url: socketUrl(session), onMessage: (message) => onMessage(role, message),
            onLink: (link) => onLink(role, link), beforeRetry: () => beforeRetry(role, session), onHeldBack });
          open.set(role, { session, follower, askedFor: null });
        }
        const link = /** @type {NonNullable<ReturnType<typeof open.get>>} */ (open.get(role));
        if (board.hasGap && link.askedFor !== board.frame && link.follower.send(askHistory())) link.askedFor = board.frame;
      }
    },
    /** Send a message of a player's; return whether it left.
     * @param {Role} role @param {object} message */
    send(role, message) {
      const hasLeft = open.get(role)?.follower.send(message) ?? false;
      if (hasLeft && role === "player") owedSince_ms = Math.min(owedSince_ms, performance.now());
      return hasLeft;
    },
  };
}
