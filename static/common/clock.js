// A board on which time runs: its presses leave at once, and a card over it says that it stands still or counts down.
// The server makes the moves, from the keys that are held; the page sends none.
import { create, put } from "./page.js";
import { spoken, t } from "./texts.js";

/** How often the countdown is painted, ms. */
const PAINTED_MS = 100;

/** Return what the card says, null while time runs or the episode is over.
 * @param {ClockState | null | undefined} clock @param {Frame | null | undefined} frame @param {number} frames a second
 * @param {boolean} isTouch @param {number} passed_ms since the state began */
export function cardOf(clock, frame, frames, isTouch, passed_ms) {
  if (!clock || !frame || frame.outcome !== null || clock.state === "running") return null;
  if (clock.state === "countdown") return { title: String(Math.max(1, Math.ceil((clock.ms - passed_ms) / 1000))), line: "" };
  const press = isTouch ? t("clock.tap", "Tap here or a button") : t("clock.press", "Press one of your keys");
  if (frame.step === 0) return { title: t("clock.ready", "Ready?"), line: t("clock.ready_line", "Time runs here: {frames} frames a second, from a countdown on. {press} to begin.", { frames, press }) };
  const reason = clock.reason ? spoken(clock, clock.reason) : t("clock.still", "Time stands still.");
  return { title: t("pause.title", "Paused"), line: t("clock.paused_line", "{reason} {press} to go on; what was held is let go.", { reason, press }) };
}

/** @param {Socket.RepeatProgress} remade @returns what the card says while an environment that was lost is made again */
export const remadeOf = ({ done, of }) => ({
  title: t("loading.title", "One moment"), line: t("clock.remade", "The environment was lost. It is made again: move {done} of {of}.", { done, of }),
});

/** Return the part of a page for a board on a clock; without one it hands everything on.
 *   place   shows the card
 *   frames  of the task, a second; null where moves are waited for
 *   board   that is driven here
 * @param {{place: HTMLElement, telemetry: Telemetry, frames: () => number | null, board: () => Board | null | undefined}} how */
export function createClock({ place, telemetry, frames, board }) {
  const title = create("b", []);
  const line = create("span", []);
  const card = create("button", [title, line], { type: "button", class: "clock-card", "data-testid": "clock", "aria-live": "polite" });
  card.hidden = true;
  place.append(card);
  /** @type {ClockState | null | undefined} */
  let shown = null;
  let since_ms = 0;
  let painting = 0;
  /** @param {RecordedEvent["kind"]} kind */
  function send(kind) {
    telemetry.note(kind);
    telemetry.sendAll();
  }
  const isRunning = () => frames() !== null && ["running", "countdown"].includes(board()?.clock?.state ?? "");
  const pause = () => { if (isRunning()) send("pause"); };
  function goOn() {
    const on = board();
    if (on?.clock?.state === "standing" && on.frame.outcome === null) send("resume");
  }
  function paint() {
    const on = board();
    if (on?.clock !== shown) {
      shown = on?.clock;
      since_ms = performance.now();
      clearInterval(painting);
      if (shown?.state === "countdown") painting = setInterval(paint, PAINTED_MS);
    }
    const said = on?.remade ? remadeOf(on.remade) : cardOf(shown, on?.frame, frames() ?? 0, matchMedia("(pointer: coarse)").matches, performance.now() - since_ms);
    card.hidden = said === null;
    if (!said) return;
    card.classList.toggle("is-counting", said.line === "");
    put(title, said.title);
    put(line, said.line);
  }
  card.addEventListener("click", goOn);
  // what is pressed in a dialog is not noted, so that a key could seem to be held for ever
  document.addEventListener("focusin", (event) => { if (/** @type {Element} */ (event.target).closest("dialog[open]")) pause(); });
  return {
    goOn, pause, paint,
    isOn: () => frames() !== null,
    /** The telemetry of the controls: presses are sent at once, and a held key's repetitions never. */
    telemetry: {
      ...telemetry,
      /** @type {Telemetry["note"]} */
      note(kind, fields = {}) {
        if (frames() === null) return telemetry.note(kind, fields);
        if (fields.repeat) return;
        telemetry.note(kind, { ...fields, ...("trusted" in fields ? { trusted: fields.trusted && navigator.webdriver !== true } : {}) });
        telemetry.sendAll();
      },
    },
  };
}
