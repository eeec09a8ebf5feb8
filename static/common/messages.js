// Every message in both directions: the twin of app/humanplay/board/messages.py (a test compares them). Types: types.d.ts.

export const FROM_SERVER = ["frame", "history", "refused", "error", "pace", "clock", "remade", "kept"];

/** Return the act message. `step` is the number of moves made when it is due; `action` is the move's name.
 * @param {string} episode @param {number} step @param {Action} action @param {Timing} timing */
export function act(episode, step, action, timing) {
  return { kind: "act", episode, step, action, ...timing };
}

/** Return the message that brings input events.
 * @param {string} episode @param {RecordedEvent[]} batch at most 200
 * @param {{batch: string, page_load: string, tab: string}} ids of the batch, by which the server knows it when it comes
 *   again, and of where it comes from */
export function events(episode, batch, ids) {
  return { kind: "events", episode, ...ids, events: batch };
}

/** Return the request for the path of the whole episode. */
export function askHistory() {
  return { kind: "history" };
}

/** Return the message in `text`, or null when it is not one of the messages above.
 * @param {string} text @returns {FromServer | null} */
export function parse(text) {
  try {
    const message = JSON.parse(text);
    return FROM_SERVER.includes(message?.kind) ? message : null;
  } catch {
    return null;
  }
}
