// What the buttons of the study's screens do, which of them Enter presses, and the pause: how long nothing was pressed, and what follows.
import { by, copied } from "../common/page.js";
import { tabStore } from "../common/storage.js";
import { t } from "../common/texts.js";
import { dispatch, frame, go, isBusy, name, stage, state, step, study } from "./store.js";
import { createIdleTimer, goesOn, knowsTheEnd, screenOf } from "./state.js";

/** @param {string} what @returns where this tab keeps it */
export const keep = (what) => `humanplay.study.${name}.${what}`;
export const isDialogOpen = () => Boolean(document.querySelector("dialog[open]"));
export const announce = (/** @type {string} */ text) => { by("announcer").textContent = text; };
export const idle = createIdleTimer(() => performance.now());
/** @type {{note: (kind: "pause" | "resume") => void, flush: () => void}} */
let telemetry = { note() {}, flush() {} };
/** @param {typeof telemetry} found that records pauses */
export const recordPauses = (found) => { telemetry = found; };

/** Begin or end a pause; a reload finds a paused board paused.
 * @param {boolean} isPaused */
export function pause(isPaused) {
  telemetry.note(isPaused ? "pause" : "resume");
  idle.touch();
  if (isPaused) tabStore.setItem(keep("paused"), frame()?.episode ?? "");
  else tabStore.removeItem(keep("paused"));
  announce(isPaused ? t("pause.said", "Paused. Press a key that moves, or Go on.") : t("pause.over", "Going on."));
  dispatch({ kind: "paused", isPaused });
  telemetry.flush();
}

const goNext = () => go(() => study.next(), stage());
const leaveTutorial = () => go(async () => {
  const on = frame();
  if (on && !on.outcome) await study.giveUp(on.episode, on.step);
  return study.advance("tutorial");
}, "tutorial");

/** Leave the end card, for wherever the study goes from there. */
function passEnd() {
  const ended = frame();
  const { participant } = state;
  if (!ended || !participant || !knowsTheEnd(state) || isBusy) return;
  if (participant.phase === "tutorial") return void leaveTutorial();
  if (goesOn(participant)) return void goNext();
  tabStore.setItem(keep("passed"), ended.episode);
  dispatch({ kind: "passed", episode: ended.episode });
}
function giveUp() {
  by("give-up", HTMLDialogElement).close();
  const on = frame();
  if (on) step(() => study.giveUp(on.episode, on.step), stage());
}
/** @param {boolean} erase whether they ask that what they have played be erased */
function leave(erase) {
  by("leave", HTMLDialogElement).close();
  const { participant } = state;
  step(() => (participant?.stage === "consent" ? study.consent(participant.consent.version, false) : study.withdraw(erase)), participant?.stage);
}
async function copyCode() {
  const isCopied = await copied(by("code").textContent ?? "");
  if (!isCopied) document.getSelection()?.selectAllChildren(by("code"));
  by("copied").textContent = isCopied ? t("complete.copied", "Copied.") : t("complete.selected", "The code is selected: copy it with your browser.");
}

/** @type {Record<string, () => unknown>} */
const clicks = {
  retry: () => location.reload(),
  agree: () => go(() => study.consent(state.participant?.consent.version ?? "", true), "consent"),
  "to-tutorial": () => go(async () => { await study.advance("instructions"); return study.next(); }, "instructions"),
  begin: goNext, "end-break": goNext, next: passEnd, practise: goNext, skip: leaveTutorial, resume: () => pause(false),
  finish: () => (stage() === "complete" ? dispatch({ kind: "looked-back", looksBack: false }) : go(() => study.advance("debrief"), "debrief")),
  "look-back": () => dispatch({ kind: "looked-back", looksBack: true }),
  "give-up-now": giveUp, "leave-now": () => leave(false), "leave-erase": () => leave(true), copy: copyCode,
};
for (const [id, work] of Object.entries(clicks)) by(id).addEventListener("click", work);

/** Press the screen's button with Enter, unless Enter belongs to another one; return whether it was used. */
export function onEnter() {
  const focused = document.activeElement;
  if (isDialogOpen()) return false;
  const playing = state.isPaused ? "resume" : frame()?.outcome ? "next" : null;
  const id = { play: playing, ready: "begin", break: "end-break", instructions: "to-tutorial" }[/** @type {"play"} */ (screenOf(state))];
  const main = id ? by(id) : null;
  if (!main || (focused?.matches("button, a, input, select") && focused !== main)) return false;
  main.click();
  return true;
}
