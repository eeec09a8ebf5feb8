// Keys, colours and arrow buttons: chosen in a dialog, kept in this browser, sent to the server.
import { create, by, put } from "../common/page.js";
import { keyName } from "../common/task.js";

const KEPT = "humanplay.study.settings";

/** Return the choices that were kept, with defaults for what is missing or wrong.
 * @param {Partial<Record<keyof Study.Choices, unknown>> | null} kept
 * @param {{wantsContrast: boolean, isTouch: boolean, keys: Keys}} system with the task's keys @returns {Study.Choices} */
export function readChoices(kept, { wantsContrast, isTouch, keys }) {
  const pad = typeof kept?.pad === "boolean" ? kept.pad : isTouch;
  const modality = kept?.modality === "touch" || kept?.modality === "keyboard" ? kept.modality : isTouch ? "touch" : "keyboard";
  return { modality, palette: readPalette(kept?.palette, wantsContrast), keys: readKeys(/** @type {Record<string, unknown> | undefined} */ (kept?.keys), keys), pad };
}

/** @param {string | null} text */
function parsed(text) {
  try {
    return JSON.parse(text ?? "null");
  } catch {
    return null;
  }
}

/** @param {{layout: () => Study.Layout | undefined, onChange: (choices: Study.Choices) => void}} how */
export function createSettings({ layout, onChange }) {
  const isAsked = (/** @type {string} */ query) => matchMedia(query).matches;
  const kept = parsed(localStorage.getItem(KEPT));
  const system = { wantsContrast: isAsked("(prefers-contrast: more)"), isTouch: isAsked("(pointer: coarse), (max-width: 700px)") };
  /** @type {Keys} the task's own, none before it is known */
  let own = {};
  let choices = readChoices(kept, { ...system, keys: own });
  /** @type {{action: Action, slot: number} | null} a slot that waits for its key */
  let awaited = null;

  /** @param {Partial<Study.Choices>} changed */
  function change(changed) {
    choices = { ...choices, ...changed };
    localStorage.setItem(KEPT, JSON.stringify(choices));
    paint();
    onChange(choices);
  }
  function paint() {
    document.documentElement.dataset.palette = choices.palette;
    document.body.dataset.pad = String(choices.pad);
    by("show-pad", HTMLInputElement).checked = choices.pad;
    for (const input of /** @type {NodeListOf<HTMLInputElement>} */ (document.querySelectorAll("#palettes input"))) input.checked = input.value === choices.palette;
    for (const button of /** @type {NodeListOf<HTMLButtonElement>} */ (document.querySelectorAll("#keymap button"))) {
      const action = /** @type {Action} */ (button.dataset.drive);
      const slot = Number(button.dataset.slot);
      const isAwaited = awaited?.action === action && awaited.slot === slot;
      put(button, isAwaited ? "press a key" : keyName(choices.keys[action][slot], layout()));
      button.dataset.awaited = String(isAwaited);
      button.setAttribute("aria-label", `${action}, ${slot === 0 ? "first" : "second"} key: ${isAwaited ? "press the key you want" : spokenKey(choices.keys[action][slot], layout())}`);
    }
  }
  function build() {
    by("palettes").replaceChildren(...Object.entries(PALETTES).map(([name, { title, hint }]) => create("label", [
      create("input", [], { type: "radio", name: "palette", value: name, "data-testid": `palette-${name}` }),
      create("span", [create("b", title), create("small", hint)]),
    ], { "data-palette": name })));
    by("keymap").replaceChildren(...Object.entries(own).map(([action, codes]) => create("tr", [create("th", action, { scope: "row" }), ...codes.map((_, slot) =>
      create("td", create("button", [], { type: "button", class: "quiet", "data-drive": action, "data-slot": String(slot), "data-testid": `key-${action}-${slot}` })))])));
  }
  build();
  paint();
  by("palettes").addEventListener("change", (event) => change({ palette: readPalette(/** @type {HTMLInputElement} */ (event.target).value, false) }));
  by("show-pad").addEventListener("change", () => change({ pad: by("show-pad", HTMLInputElement).checked }));
  by("reset-keys").addEventListener("click", () => { awaited = null; change({ keys: { ...own } }); put(by("key-status"), "The keys are as they were at first."); });
  by("keymap").addEventListener("click", (event) => {
    const button = /** @type {Element} */ (event.target).closest("button");
    if (!button) return;
    awaited = { action: /** @type {Action} */ (button.dataset.drive), slot: Number(button.dataset.slot) };
    put(by("key-status"), `Press the key that should drive ${button.dataset.drive}; Escape leaves it as it is.`);
    paint();
  });
  by("settings").addEventListener("keydown", (event) => {
    if (!awaited || /^(Shift|Control|Alt|Meta|OS)/.test(event.code)) return;
    if (event.code === "Tab") return leave();
    event.preventDefault();
    event.stopPropagation();
    const { action, slot } = awaited;
    if (event.code === "Escape") return leave();
    const keys = assign(choices.keys, action, slot, event.code);
    if (typeof keys === "string") return put(by("key-status"), keys);
    awaited = null;
    change({ keys });
    put(by("key-status"), `${keyName(event.code, layout())} now drives ${action}.`);
  });
  function leave() {
    awaited = null;
    put(by("key-status"), "");
    paint();
  }
  by("settings").addEventListener("close", leave);
  return {
    /** @returns {Study.Choices} */
    get: () => choices,
    paint,
    /** Take the keys of the task, or those that were chosen for it.
     * @param {Keys} keys */
    begin(keys) {
      own = keys;
      choices = { ...choices, keys: readKeys(kept?.keys, own) };
      build();
      paint();
    },
    /** Take over what the server keeps, in place of what this browser kept.
     * @param {Study.Participant["settings"]} stored */
    adopt(stored) {
      if (!stored.keys || !stored.palette) return;
      choices = { ...choices, keys: readKeys(stored.keys, own), palette: readPalette(stored.palette, false), modality: stored.modality ?? choices.modality };
      localStorage.setItem(KEPT, JSON.stringify(choices));
      paint();
    },
    /** Note how the last move was made.
     * @param {Study.Settings["modality"]} modality */
    drove(modality) { if (modality !== choices.modality) change({ modality }); },
  };
}

const DRIVING = /^(Key[A-Z]|Digit\d|Numpad\w+|Arrow(Up|Right|Down|Left)|Comma|Period|Slash|Semicolon|Quote|Bracket(Left|Right)|Backslash|Minus|Equal|Backquote|Intl\w+|Home|End|PageUp|PageDown|Insert|Delete)$/;
const SPOKEN = { ArrowUp: "arrow up", ArrowRight: "arrow right", ArrowDown: "arrow down", ArrowLeft: "arrow left" };

/** @param {string} code @returns whether a key may drive: Tab, Enter, Escape, space and the like stay with the page */
export const mayDrive = (code) => DRIVING.test(code) && code !== "NumpadEnter";

/** Return the map with `code` in a slot, or a sentence that says why not. A key that drove elsewhere changes places with the
 * one it replaces.
 * @param {Keys} keys @param {Action} action @param {number} slot 0 or 1 @param {string} code @returns {Keys | string} */
export function assign(keys, action, slot, code) {
  if (!mayDrive(code)) return `${keyName(code)} cannot drive here: choose a letter, a digit, an arrow or a number-pad key.`;
  const old = keys[action][slot];
  return Object.fromEntries(Object.entries(keys).map(([each, codes]) => [each, codes.map((known, place) => {
    if (each === action && place === slot) return code;
    return known === code ? old : known;
  })]));
}

/** Return a kept map if it is a whole one of the task's, else the task's own.
 * @param {Record<string, unknown> | null | undefined} kept @param {Keys} own @returns {Keys} */
export function readKeys(kept, own) {
  const lists = Object.entries(own).map(([action, codes]) => ({ list: kept?.[action], of: codes.length }));
  const isWhole = lists.every(({ list, of }) => Array.isArray(list) && list.length === of && list.every((code) => typeof code === "string" && mayDrive(code)));
  const codes = lists.flatMap(({ list }) => list);
  return isWhole && new Set(codes).size === codes.length ? Object.fromEntries(Object.keys(own).map((action, index) => [action, /** @type {string[]} */ (lists[index].list)])) : { ...own };
}

/** @param {string} code @param {Study.Layout} [layout] @returns the same for a screen reader */
export const spokenKey = (code, layout) => /** @type {Record<string, string>} */ (SPOKEN)[code] ?? keyName(code, layout);

/** @type {Record<Study.PaletteName, Study.Palette>} */
export const PALETTES = {
  mars: { title: "Mars", hint: "Soil and night", inks: { text: "#a8988d", goal: "#e8ddd3", base: "#5a453a", line: "#2a2023" } },
  "colour-blind": { title: "Colour-blind", hint: "Blue and yellow, told apart by lightness too",
    inks: { text: "#a9b7c6", goal: "#e6ecf2", base: "#4b5f76", line: "#1f2b39" } },
  "high-contrast": { title: "High contrast", hint: "White on black, strong edges",
    inks: { text: "#ffffff", goal: "#ffffff", base: "#ffffff", line: "#5a5a5a" } },
};

/** Return a kept name if it is one of ours, else what the system asks for.
 * @param {unknown} name @param {boolean} wantsContrast @returns {Study.PaletteName} */
export function readPalette(name, wantsContrast) {
  if (typeof name === "string" && Object.hasOwn(PALETTES, name)) return /** @type {Study.PaletteName} */ (name);
  return wantsContrast ? "high-contrast" : "mars";
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
