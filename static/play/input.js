// @ts-check
// What the person at the board presses: the moves, and the input events that cause them, on one socket.
import { startControls } from "../common/controls.js";
import { recordInputEvents } from "../common/input_events.js";
import { KEYS } from "../common/keyboard.js";
import { createMoveSender } from "../common/pending_moves.js";
import { createTelemetry, onScreen } from "../common/telemetry.js";
import { createHeldKey, paceOf } from "./held_key.js";
import { createPressQueue } from "./press_queue.js";

/** @typedef {import("../common/messages.js").Frame} Frame */
/** @typedef {import("../common/messages.js").Timing} Timing */
/** Where events without an answer wait for the next load of this tab. */
const KEPT = "mars.events";
/** How many moves a second a held key makes in practice. */
export const REPEAT_SETTING = "mars.repeat";

/**
 * Start the controls; return the moves and the telemetry, for the server's answers.
 *   frames      in which keys drive as well, such as the 3-D views
 *   send        true when the message left
 *   driven      the newest frame of a board that is driven here, else null
 *   painted     the frame that was painted last
 *   isPractice  whether held keys repeat, and bursts stop before rocks that are known
 *   onDropped   some presses will make no move
 *   onActivity  anything was pressed: the user is there
 * @param {{page: Window & typeof globalThis, frames: HTMLIFrameElement[], pad: HTMLElement, send: (message: object) => boolean,
 *   driven: () => Frame | null, painted: () => Frame | null, isPractice: () => boolean,
 *   onDropped: (reason: import("./press_queue.js").Reason, count: number) => void, onActivity: () => void,
 *   onEnter: (event: KeyboardEvent) => boolean}} how
 */
export function startInput({ page, frames, pad, send, driven, painted, isPractice, onDropped, onActivity, onEnter }) {
  const now_ms = () => page.performance.now();
  const sendEvents = () => telemetry.sendAll();
  const sender = createMoveSender({ send, now_ms, sendEvents });
  const moves = createPressQueue({ sender, frame: driven, isPractice, sendEvents, now_ms, onDropped });
  const telemetry = createTelemetry({ now_ms, send, stored: JSON.parse(page.sessionStorage.getItem(KEPT) ?? "[]"),
    store: (batches) => page.sessionStorage.setItem(KEPT, JSON.stringify(batches)),
    context: () => onScreen(driven(), painted(), moves.round_trip_ms()) });
  /**
   * Of the press that is held.
   * @type {{timing: Timing, episode: string} | null}
   */
  let held = null;
  const heldKey = createHeldKey({
    now_ms, pace: () => paceOf(page.localStorage.getItem(REPEAT_SETTING)),
    mayRepeat: () => isPractice() && driven()?.outcome === null && driven()?.episode === held?.episode && !page.document.querySelector("dialog[open]"),
    repeat: (action) => held !== null && moves.repeat(action, { ...held.timing, key_up_ms: null, client_ms: Math.round(now_ms() * 10) / 10 }),
    after(wait_ms, work) {
      const timer = page.setTimeout(work, wait_ms);
      return () => page.clearTimeout(timer);
    },
  });
  recordInputEvents({ page, frames, pad, note: telemetry.note, flush: telemetry.flush, leave: telemetry.leave, onActivity, drives: (code) => code in KEYS });
  startControls({
    page, frames, pad, onEnter,
    onAct(action, timing, pressed_ms, holder) {
      const on = driven();
      if (!on) return;
      moves.press(action, timing, pressed_ms);
      held = { timing, episode: on.episode };
      heldKey.down(holder, action);
    },
    onLetGo: (holder) => (holder === null ? heldKey.stop() : heldKey.up(holder)),
  });
  page.document.addEventListener("visibilitychange", heldKey.stop);
  page.setInterval(telemetry.flush, 1000);
  return { moves, telemetry };
}
