// @ts-check
// What the person at the board presses: the moves, and the input events that cause them, on one socket.
import { startControls } from "../common/controls.js";
import { recordInputEvents } from "../common/input_events.js";
import { KEYS } from "../common/keyboard.js";
import { createMoveSender } from "../common/pending_moves.js";
import { createTelemetry, onScreen } from "../common/telemetry.js";

/** @typedef {import("../common/messages.js").Frame} Frame */
/** Where events without an answer wait for the next load of this tab. */
const KEPT = "mars.events";

/**
 * Start the controls; return the moves and the telemetry, for the server's answers.
 *   frames      in which keys drive as well, such as the 3-D views
 *   send        true when the message left
 *   driven      the newest frame of a board that is driven here, else null
 *   painted     the frame that was painted last
 *   onActivity  anything was pressed: the user is there
 * @param {{page: Window & typeof globalThis, frames: HTMLIFrameElement[], pad: HTMLElement, send: (message: object) => boolean,
 *   driven: () => Frame | null, painted: () => Frame | null, onActivity: () => void, onEnter: (event: KeyboardEvent) => boolean}} how
 */
export function startInput({ page, frames, pad, send, driven, painted, onActivity, onEnter }) {
  const now_ms = () => page.performance.now();
  const moves = createMoveSender({ send, now_ms, sendEvents: () => telemetry.sendAll() });
  const telemetry = createTelemetry({ now_ms, send, stored: JSON.parse(page.sessionStorage.getItem(KEPT) ?? "[]"),
    store: (batches) => page.sessionStorage.setItem(KEPT, JSON.stringify(batches)),
    context: () => onScreen(driven(), painted(), moves.round_trip_ms()) });
  recordInputEvents({ page, frames, pad, note: telemetry.note, flush: telemetry.flush, leave: telemetry.leave, onActivity, drives: (code) => code in KEYS });
  startControls({
    page, frames, pad, onEnter,
    onAct(action, timing, pressed_ms) {
      const frame = driven();
      if (frame) moves.press(frame, action, timing, pressed_ms);
    },
  });
  page.setInterval(telemetry.flush, 1000);
  return { moves, telemetry };
}
