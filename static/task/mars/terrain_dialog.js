// The dialog in which a terrain and the policies are chosen.
import { create, createSvg } from "../../common/page.js";
import { levelGroups, levelName, policyName } from "./names.js";

export const MAX_SEED = 2 ** 53 - 1;
/** How the value of a map begins among the levels. */
const MAP = "map:";

/** Return the wish that the filled form stands for, or a sentence that says what is wrong.
 * @param {Record<string, string>} fields @returns {Play.Wish | string} */
export function readWish({ level, side, rows, cols, seed, rival, player }) {
  if (level?.startsWith(MAP)) return { level: "map", map: level.slice(MAP.length), size: 21, seed: null, rival, player };
  /** @type {number | [number, number]} */
  let size = Number(side);
  if (side === "custom") {
    size = [Number(rows), Number(cols)];
    const wrong = size.find((length) => !Number.isInteger(length) || length < 5 || length > 128);
    if (wrong !== undefined) return `Rows and columns must be whole numbers from 5 to 128, got ${rows} and ${cols}.`;
  }
  const digits = seed.trim();
  if (digits && (!/^[0-9]+$/.test(digits) || Number(digits) > MAX_SEED)) return `A seed is a whole number from 0 to ${MAX_SEED}, got ${digits}.`;
  return { level, map: null, size, seed: digits ? Number(digits) : null, rival, player };
}

/** @param {string[]} names @returns the policy that a newcomer plays with */
export function favourite(names) {
  return names.find((name) => name.includes("ppo")) ?? names.find((name) => name === "frontier-utility") ?? names.at(-1) ?? "";
}

/** @param {HTMLSelectElement} select @param {{name: string, summary?: string}[]} choices @param {string} chosen */
function fill(select, choices, chosen) {
  select.replaceChildren(...choices.map(({ name }) => new Option(policyName(name), name, false, name === chosen)));
}

/** Offer the levels: those with plain names, then the paper's codes.
 * @param {HTMLSelectElement} select @param {string[]} names */
function fillLevels(select, names) {
  const { plain, paper } = levelGroups(names);
  const options = (/** @type {string[]} */ levels) => levels.map((name) => new Option(levelName(name), name, false, name === "random"));
  select.replaceChildren(...options(plain));
  if (!paper.length) return;
  const group = document.createElement("optgroup");
  group.label = "Paper levels";
  group.append(...options(paper));
  select.append(group);
}

/** @param {Mars.GivenMap[]} maps @returns maps as a group of options below the levels */
function mapGroup(maps) {
  const group = document.createElement("optgroup");
  group.label = "Maps";
  group.append(...maps.map(({ name, size: [rows, cols] }) => new Option(`${name} (${rows} \u00d7 ${cols})`, MAP + name)));
  return group;
}

/** @param {Mars.Level} level @returns a button with a terrain of the level on it */
function picture({ name, example }) {
  const rocks = example.flatMap((bits, row) => example.map((_, col) => ((bits >> col) & 1 ? `M${col} ${row}h1v1h-1z` : ""))).join("");
  const svg = createSvg("svg", { viewBox: `0 0 ${example.length} ${example.length}`, "aria-hidden": "true" }, createSvg("path", { d: rocks }));
  return create("button", [svg, levelName(name)], { type: "button", value: name });
}

/** @param {HTMLDialogElement} dialog
 * @param {{onStart: (wish: Play.Wish) => void, onWrong: (sentence: string) => void}} handlers */
export function createTerrainDialog(dialog, handlers) {
  const form = /** @type {HTMLFormElement} */ (dialog.querySelector("form"));
  const input = (/** @type {string} */ name) => /** @type {HTMLInputElement} */ (form.elements.namedItem(name));
  const select = (/** @type {string} */ name) => /** @type {HTMLSelectElement} */ (form.elements.namedItem(name));
  const side = /** @type {RadioNodeList} */ (form.elements.namedItem("side"));
  const hint = /** @type {HTMLElement} */ (form.querySelector("#level-hint"));
  const pictures = /** @type {HTMLElement} */ (form.querySelector(".levels"));
  const custom = /** @type {HTMLElement} */ (form.querySelector(".custom"));
  const drawn = /** @type {NodeListOf<HTMLElement>} */ (form.querySelectorAll("[data-drawn]"));
  /** @type {Mars.Level[]} */
  let levels = [];
  /** @type {Mars.GivenMap[]} */
  let maps = [];
  const read = () => readWish(/** @type {Record<string, string>} */ (Object.fromEntries(new FormData(form))));
  function follow() {
    const { value } = select("level");
    for (const each of pictures.children) each.setAttribute("aria-pressed", String(/** @type {HTMLButtonElement} */ (each).value === value));
    for (const each of drawn) each.hidden = value.startsWith(MAP);
    /** @type {HTMLFieldSetElement} */ (form.querySelector("fieldset")).disabled = value.startsWith(MAP);
    input("seed").disabled = value.startsWith(MAP);
    custom.hidden = input("rows").disabled = input("cols").disabled = side.value !== "custom";
    hint.textContent = (levels.find(({ name }) => name === value) ?? maps.find(({ name }) => MAP + name === value))?.summary?.replace(" (section 3.2)", "") ?? "";
  }
  form.addEventListener("change", follow);
  pictures.addEventListener("click", ({ target }) => {
    const button = /** @type {Element} */ (target).closest("button");
    if (!button) return;
    select("level").value = button.value;
    follow();
  });
  form.addEventListener("submit", (event) => {
    const wish = read();
    if (typeof wish !== "string") return handlers.onStart(wish);
    event.preventDefault();
    dialog.close();
    handlers.onWrong(wish);
  });
  return {
    /** @returns {Play.Wish} the wish as it stands; a form with an error counts as an untouched one */
    wish() {
      const wish = read();
      return typeof wish === "string" ? { level: "random", map: null, size: 21, seed: null, rival: select("rival").value, player: select("player").value } : wish;
    },
    /** Choose the policy of a board.
     * @param {Role} role @param {string} name */
    choose(role, name) { select(role).value = name; },
    /** @param {Mars.Level[]} found @param {{name: string, summary: string}[]} policies @param {Mars.GivenMap[]} given */
    offer(found, policies, given) {
      levels = found;
      maps = given;
      const names = policies.map(({ name }) => name);
      const best = favourite(names);
      fillLevels(select("level"), found.map(({ name }) => name));
      const { plain } = levelGroups(found.map(({ name }) => name));
      pictures.replaceChildren(...plain.map((name) => picture(/** @type {Mars.Level} */ (found.find((each) => each.name === name)))));
      if (maps.length) select("level").append(mapGroup(maps));
      fill(select("rival"), policies, best);
      fill(select("player"), policies, names.find((name) => name !== best && name.includes("frontier")) ?? best);
      follow();
    },
    /** Show what is being played. A chosen seed serves one terrain, and the server draws the next.
     * @param {About} about */
    show({ level, map, frame: shown, player, rival }) {
      const frame = /** @type {Mars.Frame} */ (shown);
      input("seed").value = "";
      select("level").value = map ? MAP + map : level;
      if (select("level").selectedIndex < 0) select("level").value = "random"; // a map that is not on offer any more
      const length = frame.rows === frame.cols && [21, 42, 84].includes(frame.rows) ? String(frame.rows) : "custom";
      side.value = length;
      if (length === "custom") [input("rows").value, input("cols").value] = [String(frame.rows), String(frame.cols)];
      if (rival) select("rival").value = rival.policy;
      if (player !== "human") select("player").value = player;
      follow();
    },
  };
}
