// @ts-check
// Keys, colours and arrow buttons: kept in this browser, told to the server, chosen on a sheet.
import { put } from "../common/panels.js";
import { ACTIONS } from "../common/messages.js";
import { assign, DEFAULT_KEYS, keyName, readKeys, spokenKey } from "./keymap.js";
import { PALETTES, readPalette } from "./palettes.js";

/**
 * @typedef {import("./api.js").Settings} Settings
 * @typedef {Settings & {pad: boolean}} Choices
 */
const KEPT = "mars.study.settings";

/**
 * Choices from what was kept, whole whatever was kept.
 * @param {any} kept
 * @param {{wantsContrast: boolean, isTouch: boolean}} system
 * @returns {Choices}
 */
export function readChoices(kept, { wantsContrast, isTouch }) {
  const pad = typeof kept?.pad === "boolean" ? kept.pad : isTouch;
  const modality = kept?.modality === "touch" || kept?.modality === "keyboard" ? kept.modality : isTouch ? "touch" : "keyboard";
  return { modality, palette: readPalette(kept?.palette, wantsContrast), keys: readKeys(kept?.keys), pad };
}

/** @param {string | null} text */
function parsed(text) {
  try {
    return JSON.parse(text ?? "null");
  } catch {
    return null;
  }
}

/**
 * @param {Document} page
 * @param {{storage: Storage, layout: () => any, onChange: (choices: Choices) => void}} how
 */
export function createSettings(page, { storage, layout, onChange }) {
  const by = (/** @type {string} */ id) => /** @type {any} */ (page.getElementById(id));
  const view = /** @type {Window} */ (page.defaultView);
  const isAsked = (/** @type {string} */ query) => view.matchMedia(query).matches;
  let choices = readChoices(parsed(storage.getItem(KEPT)), { wantsContrast: isAsked("(prefers-contrast: more)"),
    isTouch: isAsked("(pointer: coarse), (max-width: 700px)") });
  /** @type {{action: import("../common/messages.js").Action, slot: number} | null} a slot that waits for its key */
  let awaited = null;

  /** @param {Partial<Choices>} changed */
  function change(changed) {
    choices = { ...choices, ...changed };
    storage.setItem(KEPT, JSON.stringify(choices));
    paint();
    onChange(choices);
  }
  function paint() {
    page.documentElement.dataset.palette = choices.palette;
    page.body.dataset.pad = String(choices.pad);
    by("show-pad").checked = choices.pad;
    for (const input of page.querySelectorAll("#palettes input")) /** @type {any} */ (input).checked = /** @type {any} */ (input).value === choices.palette;
    for (const button of /** @type {NodeListOf<HTMLButtonElement>} */ (page.querySelectorAll("#keymap button"))) {
      const action = /** @type {import("../common/messages.js").Action} */ (button.dataset.drive);
      const slot = Number(button.dataset.slot);
      const isAwaited = awaited?.action === action && awaited.slot === slot;
      put(button, isAwaited ? "press a key" : keyName(choices.keys[action][slot], layout()));
      button.dataset.awaited = String(isAwaited);
      button.setAttribute("aria-label", `${action}, ${slot === 0 ? "first" : "second"} key: ${isAwaited ? "press the key you want" : spokenKey(choices.keys[action][slot], layout())}`);
    }
  }
  function build() {
    by("palettes").replaceChildren(...Object.entries(PALETTES).map(([name, { title, hint }]) => {
      const label = page.createElement("label");
      label.dataset.palette = name;
      const input = Object.assign(page.createElement("input"), { type: "radio", name: "palette", value: name });
      input.dataset.testid = `palette-${name}`;
      const words = page.createElement("span");
      words.append(Object.assign(page.createElement("b"), { textContent: title }), Object.assign(page.createElement("small"), { textContent: hint }));
      label.append(input, words);
      return label;
    }));
    by("keymap").replaceChildren(...ACTIONS.map((action) => {
      const row = page.createElement("tr");
      row.append(Object.assign(page.createElement("th"), { scope: "row", textContent: action }));
      for (const slot of [0, 1]) {
        const button = Object.assign(page.createElement("button"), { type: "button", className: "quiet" });
        Object.assign(button.dataset, { drive: action, slot: String(slot), testid: `key-${action}-${slot}` });
        row.insertCell().append(button);
      }
      return row;
    }));
  }
  build();
  paint();
  by("palettes").addEventListener("change", (/** @type {any} */ event) => change({ palette: event.target.value }));
  by("show-pad").addEventListener("change", () => change({ pad: by("show-pad").checked }));
  by("reset-keys").addEventListener("click", () => { awaited = null; change({ keys: { ...DEFAULT_KEYS } }); put(by("key-told"), "Arrows and WASD drive again."); });
  by("keymap").addEventListener("click", (/** @type {any} */ event) => {
    const button = event.target.closest("button");
    if (!button) return;
    awaited = { action: button.dataset.drive, slot: Number(button.dataset.slot) };
    put(by("key-told"), `Press the key that should drive ${button.dataset.drive}; Escape leaves it as it is.`);
    paint();
  });
  by("settings").addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
    if (!awaited || /^(Shift|Control|Alt|Meta|OS)/.test(event.code)) return;
    if (event.code === "Tab") return leave();
    event.preventDefault();
    event.stopPropagation();
    const { action, slot } = awaited;
    if (event.code === "Escape") return leave();
    const keys = assign(choices.keys, action, slot, event.code);
    if (typeof keys === "string") return put(by("key-told"), keys);
    awaited = null;
    change({ keys });
    put(by("key-told"), `${keyName(event.code, layout())} now drives ${action}.`);
  });
  function leave() {
    awaited = null;
    put(by("key-told"), "");
    paint();
  }
  by("settings").addEventListener("close", leave);
  return {
    /** @returns {Choices} */
    get: () => choices,
    paint,
    /**
     * What the server keeps wins over what this browser kept.
     * @param {import("./api.js").Where["settings"]} told
     */
    adopt(told) {
      if (!told.keys || !told.palette) return;
      choices = { ...choices, keys: readKeys(told.keys), palette: readPalette(told.palette, false), modality: told.modality ?? choices.modality };
      storage.setItem(KEPT, JSON.stringify(choices));
      paint();
    },
    /**
     * The last move was made so.
     * @param {Settings["modality"]} modality
     */
    drove(modality) { if (modality !== choices.modality) change({ modality }); },
  };
}
