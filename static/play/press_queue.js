// Presses that are not sent yet: each becomes a move or is dropped with a reason, however fast they come. In practice the queue
// stops before what the page knows to end the episode; elsewhere each press is a move. No press acts on a terrain that it was not made for.
// Where a board says which actions are allowed, each press waits for the answer to the one before, and what is not allowed is not sent.
// Presses on a board that is being prepared wait for its first frame, or for the last of the moves that are made again on it.

import { forbidden } from "../common/task.js";

/** Presses that follow each other faster than this were typed ahead: nobody looks between them. */
export const BURST_MS = 100;
/** Hardly anybody answers what they see sooner than this, so a press after it goes where its player wants, whatever is there. */
export const REACTION_MS = 400;
/** Presses that may wait at one time: more than anybody types before looking. */
export const MAX_WAITING = 400;

/**
 *   sender       sends moves, and says which wait for their answer
 *   isHeld       whether presses on this frame's board wait and none is lost: its socket is being opened, or its first moves are made again
 *   sendEvents   sends the input events of the presses, which go before their moves
 *   onDropped    some presses will make no move; 0 where a held key has stopped, or the reason names the action
 * @param {{task: Pick<Task, "ahead" | "allowed">, sender: Play.Sender, frame: () => Frame | null, isPractice: () => boolean, isHeld: (on: Frame) => boolean,
 *   sendEvents: () => void, now_ms: () => number, onDropped: (reason: Play.Reason, count: number) => void}} how */
export function createPressQueue({ task, sender, frame, isPractice, isHeld, sendEvents, now_ms, onDropped }) {
  /** @type {Play.Press[]} */
  let queue = [];
  let last_ms = -Infinity;
  /** Whether the rest of a burst is dropped, and why.
   * @type {{stop: string} | null} */
  let stop = null;
  /** The episode on the board, and since when.
   * @type {{episode: string | null, since_ms: number}} */
  let board = { episode: null, since_ms: -Infinity };
  const sentActions = () => sender.pending().map(({ action }) => action);

  /** @param {Play.Reason} reason @param {number} [more] moves that were sent and will have no answer */
  function dropAll(reason, more = 0) {
    const count = queue.length + more;
    queue = [];
    if (count > 0) onDropped(reason, count);
  }
  /** Note which terrain is on the board: presses of an earlier time were made for another one.
   * @param {Frame} on @param {number} since_ms */
  function noteBoard({ episode }, since_ms) {
    if (episode === board.episode) return;
    dropAll("ended");
    stop = null;
    board = { episode, since_ms: board.episode === null ? -Infinity : since_ms };
  }
  /** @param {Frame} on @returns how many of the moves that were sent a frame leaves without an answer */
  const unanswered = ({ episode, step }) => sender.pending().filter((move) => move.episode !== episode || move.step >= step).length;
  /** @param {Frame} on @param {Action} action @returns {{stop: string} | null} why the board does not take an action */
  function refusal(on, action) {
    const stop = forbidden(task, on, action);
    return stop === null ? null : { stop };
  }
  /** @param {Frame} on @returns whether what is allowed next is known only after the moves that wait */
  const isUnknown = (on) => sender.pending().length > 0 && (task.allowed?.(on) ?? null) !== null;
  /** Send what may be sent: a few moves ahead of the answers, and in practice none into the unknown before all are there.
   * @param {Frame} on of an episode that has not ended */
  function pump(on) {
    while (queue.length > 0 && !isHeld(on) && !sender.isFull() && !isUnknown(on)) {
      const { action, timing, pressed_ms } = queue[0];
      const refused = refusal(on, action);
      if (refused) {
        queue = queue.slice(1);
        onDropped(refused, 0);
        continue;
      }
      const ground = isPractice() ? task.ahead(on, sentActions(), action) : "free";
      if (ground === "unknown" && sender.pending().length > 0) return;
      if (typeof ground === "object") {
        stop = ground;
        return dropAll(ground);
      }
      if (!sender.press(on, action, { ...timing, client_ms: tenths(now_ms()) }, pressed_ms)) return dropAll("lost");
      queue = queue.slice(1);
    }
  }
  /** Return why a press in practice makes no move, or null: it belongs to a burst that has stopped, or would hit what
   * the page knows sooner than its player can have looked.
   * @param {Frame} on @param {Action} action @param {number} gap_ms since the press before */
  function stoppedBy(on, action, gap_ms) {
    const isAlone = queue.length === 0 && sender.pending().length === 0;
    if (isAlone && gap_ms >= BURST_MS) stop = null;
    if (stop) return stop;
    const ground = task.ahead(on, [...sentActions(), ...queue.map((press) => press.action)], action);
    if (typeof ground === "string" || (isAlone && gap_ms >= REACTION_MS)) return null;
    return (stop = ground);
  }
  return {
    /** Take a press: it becomes a move now or after those before it, or it is dropped.
     * @param {Action} action @param {Timing} timing @param {number} pressed_ms */
    press(action, timing, pressed_ms) {
      const on = frame();
      if (!on) return;
      noteBoard(on, -Infinity);
      sendEvents();
      const gap_ms = pressed_ms - last_ms;
      last_ms = pressed_ms;
      if (on.outcome !== null || pressed_ms < board.since_ms) return onDropped("ended", 1);
      const reason = isPractice() && !isHeld(on) ? stoppedBy(on, action, gap_ms) : null;
      if (reason) return onDropped(reason, 1);
      if (queue.length >= MAX_WAITING) return onDropped("full", 1);
      const isAlone = queue.length === 0 && sender.pending().length === 0;
      if (!isAlone || isHeld(on)) {
        queue = [...queue, { action, timing, pressed_ms }];
        return pump(on);
      }
      const refused = refusal(on, action);
      if (refused) return onDropped(refused, 0);
      if (!sender.press(on, action, timing, pressed_ms)) onDropped("lost", 1);
    },
    /** Move once more while a key is held: never ahead of what waits, and never into what the page knows.
     * @param {Action} action @param {Timing} timing @returns {boolean} whether the key may go on */
    repeat(action, timing) {
      const on = frame();
      if (!on || on.outcome !== null) return false;
      last_ms = now_ms();
      if (queue.length > 0 || sender.pending().length > 1 || isHeld(on) || isUnknown(on)) return true;
      const refused = refusal(on, action);
      if (refused) {
        onDropped(refused, 0);
        return false;
      }
      const ground = task.ahead(on, sentActions(), action);
      if (ground === "unknown" && sender.pending().length > 0) return true;
      if (typeof ground === "object") {
        onDropped(ground, 0);
        return false;
      }
      return sender.press(on, action, timing, now_ms());
    },
    /** Take the moves that a message answers off the list, send what may follow, and return them.
     * @param {FromServer} message */
    receive(message) {
      const on = message.kind === "refused" ? message.frame : message.kind === "frame" ? message : null;
      if (!on) return sender.receive(message);
      noteBoard(on, now_ms());
      const lost = unanswered(on);
      const answered = sender.receive(message);
      if (on.outcome !== null) dropAll("ended", lost);
      else if (message.kind === "refused") dropAll("refused", lost);
      else pump(on);
      return answered;
    },
    /** Drop all that waits, sent or not: no answer can come.
     * @param {Play.Reason} [reason] */
    drop(reason = "lost") {
      const sent = sender.pending().length;
      sender.drop();
      dropAll(reason, sent);
      const on = frame();
      if (on) noteBoard(on, now_ms());
    },
    round_trip_ms: sender.round_trip_ms,
  };
}
/** @param {number} ms */
const tenths = (ms) => Math.round(ms * 10) / 10;
