// @ts-check
// The screens that are read: consent, instructions, ready, break, the end. Filled from the state, touched only where it changed.
import { put } from "../common/panels.js";
import { keyName } from "./keymap.js";
import { screenOf } from "./state.js";
import * as words from "./words.js";

/**
 * @typedef {import("./state.js").State} State
 * @typedef {import("./api.js").Where} Where
 */

/**
 * @param {Document} page
 * @param {string[]} lines
 * @returns {HTMLElement[]}
 */
const paragraphs = (page, lines) => lines.map((text) => Object.assign(page.createElement("p"), { textContent: text }));

/** @param {Document} page */
export function createPages(page) {
  const by = (/** @type {string} */ id) => /** @type {any} */ (page.getElementById(id));
  const sections = /** @type {NodeListOf<HTMLElement>} */ (page.querySelectorAll("main > [data-screen]"));
  /** @type {string | null} */
  let shown = null;

  /**
   * Shows one screen, and hands it the focus unless it is the first.
   * @param {string} screen
   */
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
  /** @param {Where} where */
  function paintConsent({ title, consent }) {
    put(by("consent-title"), title);
    by("consent-text").replaceChildren(...paragraphs(page, consent.text.split(/\n\s*\n/)));
    put(by("consent-version"), consent.version);
  }
  /** @param {Where} where */
  function paintReady(where) {
    const { title, lines, go } = words.readyText(where);
    put(by("ready-step"), words.progress(where, false));
    put(by("ready-title"), title);
    put(by("begin"), go);
    by("ready-lines").replaceChildren(...paragraphs(page, lines));
  }
  /** @param {Where} where */
  function paintComplete({ debrief, participant }) {
    put(by("code"), debrief?.completion_code ?? "");
    by("return-line").hidden = !debrief?.return_url;
    if (debrief?.return_url) by("return").href = debrief.return_url;
    put(by("label"), participant);
  }
  return {
    /**
     * @param {State} state
     * @param {State | null} before
     */
    paint(state, before) {
      const { where, problem } = state;
      const screen = screenOf(state);
      if (where !== before?.where || screen !== (before && screenOf(before))) {
        if (where) {
          put(by("title"), where.title);
          put(by("progress"), words.progress(where, screen === "play" && !state.table.player?.frame.outcome));
          by("way").style.width = `${(100 * words.share(where)).toFixed(1)}%`;
          page.title = `${where.title} \u00b7 ${words.progress(where, false)}`;
          if (where.note) put(by("withdrawn-note"), where.note);
        }
        if (where && screen === "consent") paintConsent(where);
        if (where && screen === "ready") paintReady(where);
        if (where && screen === "break") put(by("break-line"), words.breakLine(where));
        if (where && screen === "complete") paintComplete(where);
        if (screen === "problem") put(by("problem"), problem ?? "");
        by("open-leave").hidden = !where || ["debrief", "complete", "withdrawn", "problem", "loading"].includes(screen);
        show(screen);
      }
    },
    /**
     * The keys as they drive now, wherever the page shows them.
     * @param {import("./keymap.js").KeyMap} keys
     * @param {any} layout
     */
    paintKeys(keys, layout) {
      for (const line of /** @type {NodeListOf<HTMLElement>} */ (page.querySelectorAll("[data-keys]"))) {
        line.replaceChildren(...[0, 1].flatMap((slot) => [
          ...(slot === 1 ? [page.createTextNode(" or ")] : []),
          ...(["north", "west", "south", "east"]).map((action) => {
            const code = keys[/** @type {"north"} */ (action)][slot];
            const key = Object.assign(page.createElement("kbd"), { textContent: keyName(code, layout) });
            return key;
          }),
        ]), page.createTextNode(" drive north, west, south, east"));
      }
    },
  };
}

