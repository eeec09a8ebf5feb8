// What the person at the board presses: the moves, and the input events that cause them, on one socket.
import { createClock } from "../common/clock.js";
import { actionOf, codesOf, partOf, startControls, timeOf_ms } from "../common/keyboard.js";
import { chosenKeys, ownCode, paintKeys, startKeymap, storeKeys } from "../common/keymap.js";
import { create, put } from "../common/page.js";
import { createMoveSender } from "../common/pending_moves.js";
import { browserStore } from "../common/storage.js";
import { createTelemetry, onScreen, tabStorage } from "../common/telemetry.js";
import { many } from "../common/words.js";
import { createPressQueue } from "./press_queue.js";

/** Where events without an answer wait for the next load of this tab. */
const KEPT = "humanplay.events";
/** How many moves a second a held key makes in practice. */
const REPEAT_SETTING = "humanplay.repeat";

/** Start the controls; return the moves and the telemetry, for the server's answers, and the keys that drive.
 *   board       the player's: it can be swiped on, and says which presses were dropped
 *   frames      in which keys drive as well, such as the 3-D views; the first is the player's
 *   settings    the choice of how many moves a second a held key makes, the button that turns sound on, and the dialog with the keys, if there is one
 *   driven      the newest frame of a board that is driven here, else null
 *   onClock     the board that is driven here, where time runs
 *   painted     the frame that was painted last
 *   isPractice  whether held keys repeat, and bursts stop before what is known to end the episode
 * @param {{task: Task, onClock: () => Board | null, board: HTMLElement, frames: HTMLIFrameElement[], pad: HTMLElement,
 *   settings: {repeat: HTMLSelectElement, sound: HTMLElement, dialog?: HTMLElement}, send: (message: object) => boolean,
 *   driven: () => Frame | null, painted: () => Frame | null, isPractice: () => boolean, isHeld: (on: Frame) => boolean,
 *   announce: (text: string) => void, onEnter: (event: KeyboardEvent) => boolean}} how */
export function startInput({ task, onClock, board, frames, pad, settings, send, driven, painted, isPractice, isHeld, announce, onEnter }) {
  const now_ms = () => performance.now();
  const actionOfKey = (/** @type {string} */ code) => actionOf(task.keys, code);
  /** @type {Keys} */
  let keys = chosenKeys(task);
  let isChosen = false;
  /** @param {Keys} chosen */
  function drive(chosen) {
    keys = chosen;
    isChosen = Object.entries(keys).some(([action, codes]) => String(codes) !== String(task.keys[action]));
    showKeys();
  }
  const keymap = settings.dialog && startKeymap(settings.dialog, { keys: () => keys, onLayout: () => showKeys(), onChange(chosen) {
    storeKeys(task, chosen);
    drive(chosen);
  } });
  function showKeys() { paintKeys(task, keys, keymap?.layout()); }
  keymap?.begin(task.keys);
  drive(keys);
  /** @param {KeyboardEvent} event @returns the code of the task's own key in whose place it was chosen */
  function codeOf(event) {
    const codes = codesOf(event).map((code) => (isChosen ? ownCode(keys, task.keys, code) : code));
    return codes.find((code) => code && partOf(task.keys, code));
  }
  const sendEvents = () => telemetry.sendAll();
  const mark = create("p", [], { class: "drop-mark", "data-testid": "dropped", "aria-hidden": "true" });
  mark.hidden = true;
  board.append(mark);
  /** @type {{reason: Play.Reason, count: number} | null} */
  let shown = null;
  let hiding = 0;
  let saying = 0;
  /** @param {Play.Reason} reason @param {number} count */
  function showDropped(reason, count) {
    shown = addedUp(shown, reason, count);
    const text = droppedText(shown.reason, shown.count);
    put(mark, text);
    mark.hidden = false;
    clearTimeout(hiding);
    clearTimeout(saying);
    saying = setTimeout(() => announce(text), QUIET_MS);
    hiding = setTimeout(() => { mark.hidden = true; shown = null; }, SHOWN_MS);
  }
  const sound = createSound(settings.sound, { storage: browserStore, makeContext: () => new AudioContext() });
  const moves = createPressQueue({
    sender: createMoveSender({ send, now_ms, sendEvents }), task, frame: driven, isPractice, isHeld, sendEvents, now_ms,
    onDropped(reason, count) {
      showDropped(reason, count);
      sound.play({ kind: "blocked" });
    },
  });
  const telemetry = createTelemetry({ now_ms, send, isHidden: () => document.hidden, ...tabStorage(KEPT),
    context: () => onScreen(driven(), painted(), moves.round_trip_ms()) });
  const clock = createClock({ place: board, telemetry, frames: () => task.clock, board: onClock });
  /** Of the press that is held.
   * @type {{timing: Timing, episode: string} | null} */
  let held = null;
  const heldKey = createHeldKey({
    now_ms, pace: () => paceOf(browserStore.getItem(REPEAT_SETTING)),
    mayRepeat: () => isPractice() && driven()?.outcome === null && driven()?.episode === held?.episode && !document.querySelector("dialog[open]"),
    repeat: (action) => held !== null && moves.repeat(action, { ...held.timing, key_up_ms: null, client_ms: Math.round(now_ms() * 10) / 10 }),
    after(wait_ms, work) {
      const timer = setTimeout(work, wait_ms);
      return () => clearTimeout(timer);
    },
  });
  const controls = startControls({
    frames, pad, telemetry: clock.telemetry, onEnter, codeOf, actionOf: (code) => partOf(task.keys, code),
    onAct(action, timing, pressed_ms, holder) {
      const on = driven();
      if (!on) return;
      if (clock.isOn()) return clock.goOn();
      moves.press(action, timing, pressed_ms);
      held = { timing, episode: on.episode };
      heldKey.down(holder, action);
    },
    onLetGo: (holder) => (holder === null ? heldKey.stop() : heldKey.up(holder)),
  });
  const takesSwipes = () => !clock.isOn() && driven()?.outcome === null;
  /** Follow the swipes on an element or in a window, before any other listener.
   * @param {HTMLElement | View} target @param {View} view it stands in */
  function followSwipes(target, view) {
    /** @param {"touchdown" | "touchup"} kind @param {Action} action @param {PointerEvent} event */
    function note(kind, action, event) {
      const at_ms = timeOf_ms(event, view, window);
      telemetry.note(kind, { code: action, repeat: false, trusted: event.isTrusted, at_ms });
      return at_ms;
    }
    const take = createSwipe({
      isOn: takesSwipes, actionOf: actionOfKey,
      onSwipe: (action, event) => controls.press("touch", action, event, note("touchdown", action, event), "swipe"),
      onEnd: (action, event) => controls.release("swipe", note("touchup", action, event)),
    });
    for (const type of ["pointerdown", "pointermove", "pointerup", "pointercancel"]) {
      target.addEventListener(type, (event) => {
        if (!take(/** @type {PointerEvent} */ (event))) return;
        event.stopImmediatePropagation();
        if (event.cancelable) event.preventDefault();
      }, true);
    }
    // a finger that stays down must not bring up a menu
    target.addEventListener("contextmenu", (event) => { if (takesSwipes() && /** @type {PointerEvent} */ (event).pointerType !== "mouse") event.preventDefault(); }, true);
  }
  for (const surface of /** @type {NodeListOf<HTMLElement>} */ (board.querySelectorAll(".stage, .matrix"))) followSwipes(surface, window);
  frames[0].addEventListener("load", () => {
    const view = /** @type {View | null} */ (frames[0].contentWindow);
    if (view) followSwipes(view, view);
  });
  settings.repeat.value = String(paceOf(browserStore.getItem(REPEAT_SETTING)));
  settings.repeat.addEventListener("change", () => browserStore.setItem(REPEAT_SETTING, settings.repeat.value));
  document.addEventListener("visibilitychange", heldKey.stop);
  setInterval(telemetry.flush, 1000);
  return {
    telemetry, clock, keys: () => keys,
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
 * @param {Play.Reason} reason @param {number} count 0 where the reason says all */
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

/** Held for so long, a key repeats. */
export const DELAY_MS = 250;
/** Moves a second that can be chosen; 0 turns repeating off. */
const PACES = Object.freeze([0, 4, 8, 12]);
export const DEFAULT_PACE = 8;

/** @param {string | null} stored @returns the moves a second that a stored setting stands for */
export function paceOf(stored) {
  const pace = Number(stored ?? DEFAULT_PACE);
  return PACES.includes(pace) ? pace : DEFAULT_PACE;
}

/**
 *   mayRepeat  asked before each repetition: whether a held key drives now
 *   repeat     moves once more; false lets go of the key
 *   after      calls a function in so many ms and returns what cancels it
 * @param {{pace: () => number, mayRepeat: () => boolean, repeat: (action: Action) => boolean, now_ms: () => number,
 *   after: (wait_ms: number, work: () => void) => () => void}} how */
export function createHeldKey({ pace, mayRepeat, repeat, now_ms, after }) {
  /** @type {{holder: string, action: Action} | null} */
  let held = null;
  let due_ms = 0;
  let cancel = () => {};

  function stop() {
    cancel();
    held = null;
  }
  function schedule() {
    cancel = after(Math.max(0, due_ms - now_ms()), () => {
      if (!held) return;
      if (pace() === 0 || !mayRepeat() || !repeat(held.action)) return stop();
      const between_ms = 1000 / pace();
      due_ms = Math.max(due_ms, now_ms() - between_ms / 2) + between_ms; // a page that was busy catches up on nothing
      schedule();
    });
  }
  return {
    /** A key went down, after which its own move was made; it takes the place of the one that was held before.
     * @param {string} holder what is held: a key's code, or the name of a button @param {Action} action */
    down(holder, action) {
      stop();
      if (pace() === 0 || !mayRepeat()) return;
      held = { holder, action };
      due_ms = now_ms() + DELAY_MS;
      schedule();
    },
    /** A key came up; nothing changes when it is not the one that is held.
     * @param {string} holder */
    up(holder) { if (held?.holder === holder) stop(); },
    stop,
    holder: () => held?.holder ?? null,
  };
}

/** A finger that went so far has swiped. */
export const SWIPE_PX = 22;
/** So many times further along one axis than along the other: what is more diagonal waits until it is clear. */
const CLEAR = 1.25;

/** Return the arrow key that a finger's way stands for, or null while that is not clear.
 * @param {number} right_px @param {number} down_px */
export function directionOf(right_px, down_px) {
  const [across, along] = [Math.abs(right_px), Math.abs(down_px)];
  if (Math.max(across, along) < SWIPE_PX) return null;
  if (across > along * CLEAR) return right_px > 0 ? "ArrowRight" : "ArrowLeft";
  if (along > across * CLEAR) return down_px > 0 ? "ArrowDown" : "ArrowUp";
  return null;
}

/** Return what follows the fingers on one surface.
 *   onSwipe  a swipe, with the event that made it clear
 *   onEnd    the finger that swiped came up
 * @param {{isOn: () => boolean, actionOf: (code: string) => Action | undefined,
 *   onSwipe: (action: Action, event: PointerEvent) => void, onEnd: (action: Action,
 *   event: PointerEvent) => void}} how */
export function createSwipe({ isOn, actionOf, onSwipe, onEnd }) {
  /** The first finger; `isOver` once it has swiped, or a second one has joined it.
   * @type {{id: number, x: number, y: number, action: Action | null, isOver: boolean} | null} */
  let finger = null;
  /** Take a pointer event; return whether it belongs to a swipe, so that nothing else is to be done with it.
   * @param {PointerEvent} event */
  return function take(event) {
    if (event.pointerType === "mouse") return false;
    if (event.type === "pointerdown") {
      if (!isOn()) return false;
      if (event.isPrimary) finger = { id: event.pointerId, x: event.clientX, y: event.clientY, action: null, isOver: false };
      else if (finger) finger.isOver = true; // two fingers swipe nothing, and zoom nothing either
      return true;
    }
    if (event.pointerId !== finger?.id) return finger !== null;
    if (event.type === "pointermove") {
      const code = finger.isOver ? null : directionOf(event.clientX - finger.x, event.clientY - finger.y);
      const action = code && actionOf(code);
      if (!action) return true;
      Object.assign(finger, { action, isOver: true });
      onSwipe(action, event);
      return true;
    }
    const { action } = finger;
    finger = null;
    if (action) onEnd(action, event);
    return true;
  };
}

/** Where the choice is kept: "on" or absent. */
export const SOUND_SETTING = "humanplay.sound";
/** A pentatonic scale upwards, in semitones: no two of its tones are unpleasant together. */
const SCALE = [0, 2, 4, 7, 9, 12, 14, 16, 19, 21, 24, 26, 28];
const LOWEST_HZ = 262;

/** Return the sound of a new frame of one's own board, or null where nothing is to be heard.
 * @param {Pick<Task, "sound">} task @param {Frame | null | undefined} before @param {Frame | null | undefined} after */
export function soundOf(task, before, after) {
  if (!before || !after || before.episode !== after.episode || after.step <= before.step) return null;
  return task.sound(before, after);
}

/** @param {Sound} sound @returns {Play.Tone[]} the tones of a sound; the more is gained, the higher */
export function tonesOf(sound) {
  const tone = (/** @type {number} */ semitones, /** @type {number} */ at_s, /** @type {Partial<Play.Tone>} */ other = {}) =>
    ({ hertz: LOWEST_HZ * 2 ** (semitones / 12), at_s, for_s: 0.11, wave: /** @type {const} */ ("sine"), loud: 0.1, ...other });
  switch (sound.kind) {
    case "gain": return [tone(SCALE[Math.min(sound.count, SCALE.length) - 1], 0)];
    case "blocked": return [tone(-17, 0, { wave: "triangle", for_s: 0.09, loud: 0.14 })];
    case "crash": return [tone(-12, 0, { wave: "sawtooth", for_s: 0.16, loud: 0.09 }), tone(-19, 0.11, { wave: "sawtooth", for_s: 0.3, loud: 0.09 })];
    case "over": return [tone(4, 0, { for_s: 0.2 }), tone(-5, 0.16, { for_s: 0.3 })];
    case "finish": return [0, 4, 7, 12].map((semitones, index) => tone(semitones, 0.1 * index, { for_s: index === 3 ? 0.4 : 0.14 }));
  }
}

/** Return what plays sounds while the button is pressed.
 * @param {HTMLElement} button @param {{storage: Pick<Store, "getItem" | "setItem" | "removeItem">, makeContext: () => AudioContext}} how */
export function createSound(button, { storage, makeContext }) {
  let isOn = storage.getItem(SOUND_SETTING) === "on";
  /** @type {AudioContext | null} */
  let context = null;
  const show = () => button.setAttribute("aria-pressed", String(isOn));

  /** @param {AudioContext} audio @param {Play.Tone} tone */
  function sound(audio, { hertz, at_s, for_s, wave, loud }) {
    const from_s = audio.currentTime + at_s;
    const gain = new GainNode(audio, { gain: 0 });
    gain.gain.setValueAtTime(0, from_s);
    gain.gain.linearRampToValueAtTime(loud, from_s + 0.012);
    gain.gain.exponentialRampToValueAtTime(0.0005, from_s + for_s);
    const source = new OscillatorNode(audio, { type: wave, frequency: hertz });
    source.connect(gain).connect(audio.destination);
    source.start(from_s);
    source.stop(from_s + for_s + 0.02);
  }
  /** @param {Sound | null} what */
  function play(what) {
    if (!isOn || !what) return;
    context ??= makeContext();
    if (context.state === "suspended") context.resume();
    for (const each of tonesOf(what)) sound(context, each);
  }
  button.addEventListener("click", () => {
    isOn = !isOn;
    if (isOn) storage.setItem(SOUND_SETTING, "on");
    else storage.removeItem(SOUND_SETTING);
    show();
    play({ kind: "gain", count: 5 });
  });
  show();
  return { play };
}
