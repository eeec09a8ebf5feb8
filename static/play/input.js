// @ts-check
// What the person at the board presses: the moves, and the input events that cause them, on one socket.
import { startControls } from "../common/controls.js";
import { createTelemetry, onScreen, recordInputEvents } from "../common/telemetry.js";
import { actionOf, timeOf_ms } from "../common/keyboard.js";
import { create, put } from "../common/page.js";
import { createMoveSender } from "../common/pending_moves.js";
import { many } from "../common/words.js";
import { createHeldKey, paceOf } from "./held_key.js";
import { createPressQueue } from "./press_queue.js";
import { createSound, soundOf } from "./sound.js";
import { startSwipes } from "./swipe.js";

/** Where events without an answer wait for the next load of this tab. */
const KEPT = "mars.events";
/** How many moves a second a held key makes in practice. */
const REPEAT_SETTING = "mars.repeat";

/** Start the controls; return the moves and the telemetry, for the server's answers.
 *   task        what is played: its actions and keys
 *   board       the player's: it can be swiped on, and says which presses were dropped
 *   frames      in which keys drive as well, such as the 3-D views; the first is the player's
 *   settings    the choice of how many moves a second a held key makes, and the button that turns sound on
 *   send        true when the message left
 *   driven      the newest frame of a board that is driven here, else null
 *   painted     the frame that was painted last
 *   isPractice  whether held keys repeat, and bursts stop before what is known to end the episode
 *   isConnecting  whether the socket of the board's session is being opened
 *   announce    says a sentence to screen readers, politely
 *   onActivity  anything was pressed: the user is there
 * @param {{page: Window & typeof globalThis, task: Task, board: HTMLElement, frames: HTMLIFrameElement[], pad: HTMLElement,
 *   settings: {repeat: HTMLSelectElement, sound: HTMLElement}, send: (message: object) => boolean,
 *   driven: () => Frame | null, painted: () => Frame | null, isPractice: () => boolean, isConnecting: () => boolean,
 *   announce: (text: string) => void, onActivity: () => void, onEnter: (event: KeyboardEvent) => boolean}} how */
export function startInput({ page, task, board, frames, pad, settings, send, driven, painted, isPractice, isConnecting, announce, onActivity, onEnter }) {
  const now_ms = () => page.performance.now();
  const sendEvents = () => telemetry.sendAll();
  const mark = createDropMark(board, announce);
  const sound = createSound(settings.sound, { storage: page.localStorage, makeContext: () => new AudioContext() });
  const moves = createPressQueue({
    sender: createMoveSender({ send, now_ms, sendEvents }), task, frame: driven, isPractice, isConnecting, sendEvents, now_ms,
    onDropped(reason, count) {
      mark.show(reason, count);
      sound.play({ kind: "blocked" });
    },
  });
  const telemetry = createTelemetry({ now_ms, send, stored: JSON.parse(page.sessionStorage.getItem(KEPT) ?? "[]"),
    store: (batches) => page.sessionStorage.setItem(KEPT, JSON.stringify(batches)),
    context: () => onScreen(driven(), painted(), moves.round_trip_ms()) });
  /** Of the press that is held.
   * @type {{timing: Timing, episode: string} | null} */
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
  recordInputEvents({ page, frames, pad, note: telemetry.note, flush: telemetry.flush, leave: telemetry.leave, onActivity, drives: (code) => actionOf(task.keys, code) !== undefined });
  const controls = startControls({
    page, frames, pad, onEnter, actionOf: (code) => actionOf(task.keys, code),
    onAct(action, timing, pressed_ms, holder) {
      const on = driven();
      if (!on) return;
      moves.press(action, timing, pressed_ms);
      held = { timing, episode: on.episode };
      heldKey.down(holder, action);
    },
    onLetGo: (holder) => (holder === null ? heldKey.stop() : heldKey.up(holder)),
  });
  startSwipes({
    page, surfaces: [...board.querySelectorAll(".stage, .matrix")].map((each) => /** @type {HTMLElement} */ (each)), frames: frames.slice(0, 1),
    isOn: () => driven()?.outcome === null, actionOf: (code) => actionOf(task.keys, code),
    onSwipe(action, event, view) {
      onActivity();
      const at_ms = timeOf_ms(event, view, page);
      telemetry.note("touchdown", { code: action, repeat: false, trusted: event.isTrusted, at_ms });
      controls.press("touch", action, event, at_ms, "swipe");
    },
    onEnd(action, event, view) {
      const at_ms = timeOf_ms(event, view, page);
      telemetry.note("touchup", { code: action, repeat: false, trusted: event.isTrusted, at_ms });
      controls.release("swipe", at_ms);
    },
  });
  settings.repeat.value = String(paceOf(page.localStorage.getItem(REPEAT_SETTING)));
  settings.repeat.addEventListener("change", () => page.localStorage.setItem(REPEAT_SETTING, settings.repeat.value));
  page.document.addEventListener("visibilitychange", heldKey.stop);
  page.setInterval(telemetry.flush, 1000);
  return {
    telemetry,
    moves: {
      drop: moves.drop,
      /** Take the moves that a message answers off the list, and return them.
       * @param {FromServer} message */
      receive(message) {
        if (message.kind === "frame") sound.play(soundOf(task, driven(), message));
        return moves.receive(message);
      },
    },
  };
}

const SHOWN_MS = 2600;
const QUIET_MS = 500;
/** @type {Readonly<Record<string, string>>} */
const CAUSES = Object.freeze({
  ended: "The episode has ended", lost: "No connection", refused: "The board had changed meanwhile", full: "Too many presses at once",
});

/** Return the sentence about presses that make no move.
 * @param {Play.Reason} reason @param {number} count 0 where a held key has stopped */
export function droppedText(reason, count) {
  const cause = typeof reason === "string" ? CAUSES[reason] : reason.stop;
  return count === 0 ? `${cause}.` : `${cause}: ${many(count, "press", "presses")} dropped.`;
}

/** Return what the mark shows after more presses were dropped: while it is shown, those of one reason are added up, and
 * those of one burst, which may be too long for the grid first and then meet what comes into sight.
 * @param {{reason: Play.Reason, count: number} | null} shown @param {Play.Reason} reason @param {number} count */
export function addedUp(shown, reason, count) {
  const isSame = shown && (shown.reason === reason || (typeof shown.reason === "object" && typeof reason === "object"));
  return { reason, count: (isSame ? shown.count : 0) + count };
}

/** @param {HTMLElement} board gets the mark @param {(text: string) => void} announce to screen readers, politely */
function createDropMark(board, announce) {
  const mark = create("p", [], { class: "drop-mark", "data-testid": "dropped", "aria-hidden": "true" });
  mark.hidden = true;
  board.append(mark);
  /** @type {{reason: Play.Reason, count: number} | null} */
  let shown = null;
  let hiding = 0;
  let saying = 0;
  return {
    /** @param {Play.Reason} reason @param {number} count */
    show(reason, count) {
      shown = addedUp(shown, reason, count);
      const text = droppedText(shown.reason, shown.count);
      put(mark, text);
      mark.hidden = false;
      clearTimeout(hiding);
      clearTimeout(saying);
      saying = setTimeout(() => announce(text), QUIET_MS);
      hiding = setTimeout(() => { mark.hidden = true; shown = null; }, SHOWN_MS);
    },
  };
}
