// Keys, colours and arrow buttons: chosen in a dialog, kept in this browser, sent to the server.
import { readKeys, sameKeys, startKeymap } from "../common/keymap.js";
import { create, by } from "../common/page.js";
import { browserStore } from "../common/storage.js";
import { t } from "../common/texts.js";

const KEPT = "humanplay.study.settings";

/** Return the choices that were kept, with defaults for what is missing or wrong.
 * @param {Partial<Record<keyof Study.Choices, unknown>> | null} kept
 * @param {{wantsContrast: boolean, isTouch: boolean, keys: Keys}} system with the task's keys @returns {Study.Choices} */
export function readChoices(kept, { wantsContrast, isTouch, keys }) {
  const pad = typeof kept?.pad === "boolean" ? kept.pad : isTouch;
  const modality = kept?.modality === "touch" || kept?.modality === "keyboard" ? kept.modality : isTouch ? "touch" : "keyboard";
  return { modality, palette: readPalette(kept?.palette, wantsContrast), keys: readKeys(/** @type {Record<string, unknown> | undefined} */ (kept?.keys), keys), pad };
}

/** @param {{onChange: (choices: Study.Choices) => void, onLayout: () => void}} how */
export function createSettings({ onChange, onLayout }) {
  const isAsked = (/** @type {string} */ query) => matchMedia(query).matches;
  const kept = browserStore.read(KEPT);
  const system = { wantsContrast: isAsked("(prefers-contrast: more)"), isTouch: isAsked("(pointer: coarse), (max-width: 700px)") };
  /** @type {Keys} the task's own, none before it is known */
  let own = {};
  let choices = readChoices(kept, { ...system, keys: own });

  /** @param {Partial<Study.Choices>} changed */
  function change(changed) {
    choices = { ...choices, ...changed };
    keep();
    paint();
    onChange(choices);
  }
  /** Keep the choices in this browser; keys that the study gave are of no other study. */
  function keep() {
    const isChosen = !sameKeys(choices.keys, own);
    browserStore.setItem(KEPT, JSON.stringify({ ...choices, keys: isChosen ? choices.keys : undefined }));
  }
  function paint() {
    document.documentElement.dataset.palette = choices.palette;
    document.body.dataset.pad = String(choices.pad);
    by("show-pad", HTMLInputElement).checked = choices.pad;
    for (const input of /** @type {NodeListOf<HTMLInputElement>} */ (document.querySelectorAll("#palettes input"))) input.checked = input.value === choices.palette;
    keymap.paint();
  }
  function build() {
    by("palettes").replaceChildren(...Object.entries(PALETTES).map(([name, { title, hint }]) => create("label", [
      create("input", [], { type: "radio", name: "palette", value: name, "data-testid": `palette-${name}` }),
      create("span", [create("b", title), create("small", hint)]),
    ], { "data-palette": name })));
  }
  const keymap = startKeymap(by("settings"), { keys: () => choices.keys, onChange: (keys) => change({ keys }), onLayout });
  build();
  paint();
  by("palettes").addEventListener("change", (event) => change({ palette: readPalette(/** @type {HTMLInputElement} */ (event.target).value, false) }));
  by("show-pad").addEventListener("change", () => change({ pad: by("show-pad", HTMLInputElement).checked }));
  return {
    /** @returns {Study.Choices} */
    get: () => choices,
    layout: keymap.layout,
    /** Take the keys of the task, or those that were chosen for it.
     * @param {Keys} keys */
    begin(keys) {
      own = keys;
      choices = { ...choices, keys: readKeys(kept?.keys, own) };
      keymap.begin(own);
      paint();
    },
    /** Take over what the server keeps, in place of what this browser kept.
     * @param {Study.Participant["settings"]} stored */
    adopt(stored) {
      if (!stored.keys || !stored.palette) return;
      choices = { ...choices, keys: readKeys(stored.keys, own), palette: readPalette(stored.palette, false), modality: stored.modality ?? choices.modality };
      keep();
      paint();
    },
    /** Note how the last move was made.
     * @param {Study.Settings["modality"]} modality */
    drove(modality) { if (modality !== choices.modality) change({ modality }); },
  };
}

/** @type {Record<Study.PaletteName, Study.Palette>} */
export const PALETTES = {
  standard: { title: t("palette.standard", "Standard"), hint: t("palette.standard_hint", "Soil and night"), inks: { text: "#a8988d", goal: "#e8ddd3", base: "#5a453a", line: "#2a2023" } },
  "colour-blind": { title: t("palette.colour_blind", "Colour-blind"), hint: t("palette.colour_blind_hint", "Blue and yellow, told apart by lightness too"),
    inks: { text: "#a9b7c6", goal: "#e6ecf2", base: "#4b5f76", line: "#1f2b39" } },
  "high-contrast": { title: t("palette.contrast", "High contrast"), hint: t("palette.contrast_hint", "White on black, strong edges"),
    inks: { text: "#ffffff", goal: "#ffffff", base: "#ffffff", line: "#5a5a5a" } },
};

/** Return a kept name if it is one of ours, else what the system asks for.
 * @param {unknown} name @param {boolean} wantsContrast @returns {Study.PaletteName} */
export function readPalette(name, wantsContrast) {
  if (typeof name === "string" && Object.hasOwn(PALETTES, name)) return /** @type {Study.PaletteName} */ (name);
  return wantsContrast ? "high-contrast" : "standard";
}

/**
 *   save         sends the choices as they are now; `signal` ends the request
 *   settle_ms    how long the choices must stay the same before they are sent
 *   retry_ms     how long to wait after a request that failed
 *   patience_ms  how long a request may take
 * @param {{save: (signal: AbortSignal) => Promise<unknown>, settle_ms?: number, retry_ms?: number,
 *   patience_ms?: number}} how */
export function createSettingsSync({ save, settle_ms = 300, retry_ms = 2000, patience_ms = 15000 }) {
  /** @type {AbortController | null} the request that waits for its answer */
  let current = null;
  let isDue = false;
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let timer;

  /** @param {number} wait_ms */
  function later(wait_ms) {
    clearTimeout(timer);
    timer = setTimeout(send, wait_ms);
  }
  async function send() {
    clearTimeout(timer);
    if (current || !isDue) return;
    const request = current = new AbortController();
    const patience = setTimeout(() => request.abort(), patience_ms);
    isDue = false;
    const status = await save(request.signal).then(() => 200, (error) => error.status ?? 0);
    clearTimeout(patience);
    if (current !== request) return;
    current = null;
    const isLost = status === 0 || status >= 500; // what the server declines it would decline again
    isDue ||= isLost;
    if (isDue) later(isLost ? retry_ms : settle_ms);
  }
  return {
    /** Note that something was chosen. */
    changed() {
      isDue = true;
      later(settle_ms);
    },
    /** Send at once what is not sent yet, in place of a request without an answer: the page may go at any moment. */
    flush() {
      if (!isDue) return;
      current?.abort();
      current = null;
      send();
    },
  };
}
