// What the buttons of the study's screens do, and which of them Enter presses.
import { by } from "../common/page.js";
import { goesOn, knowsTheEnd, screenOf } from "./state.js";

/**
 *   onPassed    the end card of this episode was passed by
 *   look        shows the debrief again to whoever has finished, or the completion code
 * @param {{state: () => Study.State, study: ReturnType<import("./api.js").createStudyApi>,
 *   navigation: ReturnType<import("./api.js").createNavigation>, onPassed: (episode: string) => void,
 *   resume: () => void, look: (back: boolean) => void, isBlocked: () => boolean}} how */
export function startActions({ state, study, navigation, onPassed, resume, look, isBlocked }) {
  const frame = () => state().game.player?.frame;
  const stage = () => state().participant?.stage;

  const goNext = () => navigation.go(() => study.next(), stage());
  const leaveTutorial = () => navigation.go(async () => {
    const on = frame();
    if (on && !on.outcome) await study.giveUp(on.episode, on.step);
    return study.advance("tutorial");
  }, "tutorial");

  /** Leave the end card, for wherever the study goes from there. */
  function passEnd() {
    const ended = frame();
    const { participant } = state();
    if (!ended || !participant || !knowsTheEnd(state()) || navigation.isBusy()) return;
    if (participant.phase === "tutorial") return void leaveTutorial();
    if (goesOn(participant)) return void goNext();
    onPassed(ended.episode);
  }
  function giveUp() {
    by("give-up", HTMLDialogElement).close();
    const on = frame();
    if (on) navigation.step(() => study.giveUp(on.episode, on.step), stage());
  }
  function leave() {
    by("leave", HTMLDialogElement).close();
    const { participant } = state();
    navigation.step(() => (participant?.stage === "consent" ? study.consent(participant.consent.version, false) : study.withdraw()), participant?.stage);
  }
  async function copyCode() {
    const isCopied = await navigator.clipboard?.writeText(by("code").textContent ?? "").then(() => true, () => false);
    if (!isCopied) document.getSelection()?.selectAllChildren(by("code"));
    by("copied").textContent = isCopied ? "Copied." : "The code is selected: copy it with your browser.";
  }

  /** @type {Record<string, () => unknown>} */
  const clicks = {
    retry: () => location.reload(),
    agree: () => navigation.go(() => study.consent(state().participant?.consent.version ?? "", true), "consent"),
    "to-tutorial": () => navigation.go(async () => { await study.advance("instructions"); return study.next(); }, "instructions"),
    begin: goNext, "end-break": goNext, next: passEnd, again: goNext, skip: leaveTutorial, resume,
    finish: () => (stage() === "complete" ? look(false) : navigation.go(() => study.advance("debrief"), "debrief")),
    "look-back": () => look(true),
    "give-up-now": giveUp, "leave-now": leave, copy: copyCode,
  };
  for (const [id, work] of Object.entries(clicks)) by(id).addEventListener("click", work);

  return {
    /** Press the screen's button with Enter, unless Enter belongs to another one; return whether it was used. */
    onEnter() {
      const focused = document.activeElement;
      if (isBlocked()) return false;
      const playing = state().isPaused ? "resume" : frame()?.outcome ? "next" : null;
      const id = { play: playing, ready: "begin", break: "end-break", instructions: "to-tutorial" }[/** @type {"play"} */ (screenOf(state()))];
      const main = id ? by(id) : null;
      if (!main || (focused?.matches("button, a, input, select") && focused !== main)) return false;
      main.click();
      return true;
    },
  };
}

/** Return a timer that counts from the last press. The clock is an argument, so that node can test it.
 * @param {() => number} now_ms */
export function createIdleTimer(now_ms) {
  let touchedAt_ms = now_ms();
  return {
    touch() { touchedAt_ms = now_ms(); },
    /** @param {number} limit_s 0 never pauses @returns whether a board that waits for a key should pause */
    isOver: (limit_s) => limit_s > 0 && now_ms() - touchedAt_ms >= limit_s * 1000,
  };
}

/** Return what begins and ends pauses.
 *   episode    the id of the episode on the board, or ""
 *   note       records an input event; `flush` sends what is recorded
 *   storage    of this tab; `key` is where the paused episode stands in it
 * @param {{idle: ReturnType<typeof createIdleTimer>, episode: () => string, note: (kind: "pause" | "resume") => void,
 *   flush: () => void, announce: (text: string) => void, dispatch: (event: Study.Event) => void, storage: Storage,
 *   key: string}} how */
export function createPause({ idle, episode, note, flush, announce, dispatch, storage, key }) {
  return {
    /** @param {boolean} isPaused */
    set(isPaused) {
      note(isPaused ? "pause" : "resume");
      idle.touch();
      if (isPaused) storage.setItem(key, episode());
      else storage.removeItem(key);
      announce(isPaused ? "Paused. Press a driving key or Go on." : "Going on.");
      dispatch({ kind: "paused", isPaused });
      flush();
    },
    /** @param {string} id @returns whether an episode was paused before a reload */
    wasPaused: (id) => storage.getItem(key) === id,
  };
}
