// @ts-check
// Keys, colours and arrow buttons: chosen in a dialog, kept in this browser, sent to the server.
import { create, elementsOf, put } from "../common/page.js";
import { keyName } from "../common/task.js";
import { assign, readKeys, spokenKey } from "./keymap.js";
import { PALETTES, readPalette } from "./palettes.js";

const KEPT = "mars.study.settings";

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

/** @param {Document} page
 * @param {{storage: Storage, layout: () => Study.Layout | undefined, onChange: (choices: Study.Choices) => void}} how
 */
export function createSettings(page, { storage, layout, onChange }) {
  const by = elementsOf(page);
  const view = /** @type {Window} */ (page.defaultView);
  const isAsked = (/** @type {string} */ query) => view.matchMedia(query).matches;
  const kept = parsed(storage.getItem(KEPT));
  const system = { wantsContrast: isAsked("(prefers-contrast: more)"), isTouch: isAsked("(pointer: coarse), (max-width: 700px)") };
  /** @type {Keys} the task's own, none before it is known */
  let own = {};
  let choices = readChoices(kept, { ...system, keys: own });
  /** @type {{action: Action, slot: number} | null} a slot that waits for its key */
  let awaited = null;

  /** @param {Partial<Study.Choices>} changed */
  function change(changed) {
    choices = { ...choices, ...changed };
    storage.setItem(KEPT, JSON.stringify(choices));
    paint();
    onChange(choices);
  }
  function paint() {
    page.documentElement.dataset.palette = choices.palette;
    page.body.dataset.pad = String(choices.pad);
    by("show-pad", HTMLInputElement).checked = choices.pad;
    for (const input of /** @type {NodeListOf<HTMLInputElement>} */ (page.querySelectorAll("#palettes input"))) input.checked = input.value === choices.palette;
    for (const button of /** @type {NodeListOf<HTMLButtonElement>} */ (page.querySelectorAll("#keymap button"))) {
      const action = /** @type {Action} */ (button.dataset.drive);
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
      label.append(input, create("span", [create("b", title), create("small", hint)]));
      return label;
    }));
    by("keymap").replaceChildren(...Object.entries(own).map(([action, codes]) => {
      const row = page.createElement("tr");
      row.append(create("th", action, { scope: "row" }));
      for (const slot of codes.keys()) {
        const button = Object.assign(page.createElement("button"), { type: "button", className: "quiet" });
        Object.assign(button.dataset, { drive: action, slot: String(slot), testid: `key-${action}-${slot}` });
        row.insertCell().append(button);
      }
      return row;
    }));
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
      storage.setItem(KEPT, JSON.stringify(choices));
      paint();
    },
    /** Note how the last move was made.
     * @param {Study.Settings["modality"]} modality */
    drove(modality) { if (modality !== choices.modality) change({ modality }); },
  };
}
