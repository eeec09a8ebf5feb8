// @ts-check
// The screens that are read: consent, instructions, ready, break, the end. Filled from the state, touched only where it changed.
import { create, elementsOf, put } from "../common/page.js";
import { keyName } from "../common/task.js";
import { screenOf } from "./state.js";
import * as words from "./words.js";

/** @param {string[]} lines */
const paragraphs = (lines) => lines.map((text) => create("p", text));

/** @param {Document} page */
export function createPages(page) {
  const by = elementsOf(page);
  const sections = /** @type {NodeListOf<HTMLElement>} */ (page.querySelectorAll("main > [data-screen]"));
  /** @type {string | null} */
  let shown = null;

  /** Show one screen, and give it the focus unless it is the first.
   * @param {string} screen */
  function show(screen) {
    if (shown === screen) return;
    const isFirst = shown === null || shown === "loading";
    shown = screen;
    page.body.dataset.screen = screen;
    for (const section of sections) section.hidden = section.dataset.screen !== screen;
    const current = [...sections].find((section) => section.dataset.screen === screen);
    const target = screen === "play" ? by("field") : current?.querySelector("h1");
    if (!isFirst || screen === "play") target?.focus({ preventScroll: true });
    page.defaultView?.scrollTo(0, 0);
  }
  /** @param {Study.Participant} participant */
  function paintConsent({ title, consent, invited }) {
    put(by("consent-title"), title);
    by("consent-text").replaceChildren(...paragraphs(consent.text.split(/\n\s*\n/)));
    put(by("consent-version"), consent.version);
    by("consent-invited").hidden = !invited;
  }
  /** Put the numbers of the protocol into the page's own sentences.
   * @param {Study.Participant} participant */
  function paintRules({ rules }) {
    for (const place of /** @type {NodeListOf<HTMLElement>} */ (page.querySelectorAll("[data-rule]"))) {
      put(place, rules[place.dataset.rule ?? ""] ?? "");
    }
  }
  /** @param {Study.Participant} participant */
  function paintReady(participant) {
    const { title, lines, go } = words.readyText(participant);
    put(by("ready-step"), words.progress(participant, false));
    put(by("ready-title"), title);
    put(by("begin"), go);
    by("ready-lines").replaceChildren(...paragraphs(lines));
  }
  /** @param {Study.Participant} participant */
  function paintComplete({ debrief, participant }) {
    put(by("code"), debrief?.completion_code ?? "");
    by("return-line").hidden = !debrief?.return_url;
    by("look-back-line").hidden = !debrief?.ranked_terrains;
    if (debrief?.return_url) by("return", HTMLAnchorElement).href = debrief.return_url;
    put(by("label"), participant);
  }
  return {
    /** @param {Study.State} state @param {Study.State | null} before */
    paint(state, before) {
      const { participant, problem } = state;
      const screen = screenOf(state);
      if (participant !== before?.participant || screen !== (before && screenOf(before))) {
        if (participant) {
          put(by("title"), participant.title);
          paintRules(participant);
          put(by("progress"), words.progress(participant, screen === "play" && !state.game.player?.frame.outcome));
          by("progress-bar").style.width = `${(100 * words.share(participant)).toFixed(1)}%`;
          page.title = `${participant.title} \u00b7 ${words.progress(participant, false)}`;
          if (participant.note) put(by("withdrawn-note"), participant.note);
        }
        if (participant && screen === "consent") paintConsent(participant);
        if (participant && screen === "ready") paintReady(participant);
        if (participant && screen === "break") put(by("break-line"), words.breakLine(participant));
        if (participant && screen === "complete") paintComplete(participant);
        if (screen === "problem") put(by("problem"), words.sentence(problem ?? ""));
        by("open-leave").hidden = !participant || ["debrief", "complete", "withdrawn", "problem", "loading"].includes(screen);
        show(screen);
      }
    },
    /** Paint the keys as they drive now, wherever the page shows them.
     * @param {Action[]} order @param {Keys} keys @param {Study.Layout} [layout] */
    paintKeys(order, keys, layout) {
      const slots = [...(keys[order[0]] ?? []).keys()];
      for (const line of page.querySelectorAll("[data-keys]")) {
        line.replaceChildren(...slots.flatMap((slot) =>
          [...(slot ? [" or "] : []), ...order.map((action) => create("kbd", keyName(keys[action][slot] ?? "", layout)))]), ` drive ${order.join(", ")}`);
      }
    },
  };
}
