// The dialog in which a terrain and the policies are chosen.
import { create, createSvg } from "../../common/page.js";
import { firstWish, levelGroups, levelName, policyName } from "./words.js";

export const MAX_SEED = 2 ** 53 - 1;
/** Cells of a drawn terrain's longer side. */
const LONGEST_SIDE = 128;
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
    const wrong = size.find((length) => !Number.isInteger(length) || length < 5 || length > LONGEST_SIDE);
    if (wrong !== undefined) return `Rows and columns must be whole numbers from 5 to ${LONGEST_SIDE}, got ${rows} and ${cols}.`;
  }
  const digits = seed.trim();
  if (digits && (!/^[0-9]+$/.test(digits) || Number(digits) > MAX_SEED)) return `A seed is a whole number from 0 to ${MAX_SEED}, got ${digits}.`;
  return { level, map: null, size, seed: digits ? Number(digits) : null, rival, player };
}

/** @param {HTMLSelectElement} select @param {{name: string, summary?: string}[]} choices @param {string} chosen */
function fill(select, choices, chosen) {
  select.replaceChildren(...choices.map(({ name }) => new Option(policyName(name), name, false, name === chosen)));
}

/** @param {Answers.Level} level @returns a button with a terrain of the level on it */
function picture({ name, example }) {
  const rocks = example.flatMap((bits, row) => example.map((_, col) => ((bits >> col) & 1 ? `M${col} ${row}h1v1h-1z` : ""))).join("");
  const svg = createSvg("svg", { viewBox: `0 0 ${example.length} ${example.length}`, "aria-hidden": "true" }, createSvg("path", { d: rocks }));
  return create("button", [svg, levelName(name)], { type: "button", value: name });
}

/** @param {Answers.Map} map @returns a button with its name and size on it */
function mapChoice({ name, size: [rows, cols] }) {
  return create("button", `${name} ${rows} \u00d7 ${cols}`, { type: "button", value: MAP + name });
}

/** @param {HTMLDialogElement} dialog
 * @param {{onStart: (wish: Play.Wish) => void, onWrong: (sentence: string) => void}} handlers */
export function createTerrainDialog(dialog, handlers) {
  const form = /** @type {HTMLFormElement} */ (dialog.querySelector("form"));
  const input = (/** @type {string} */ name) => /** @type {HTMLInputElement} */ (form.elements.namedItem(name));
  const select = (/** @type {string} */ name) => /** @type {HTMLSelectElement} */ (form.elements.namedItem(name));
  const side = /** @type {RadioNodeList} */ (form.elements.namedItem("side"));
  const hint = /** @type {HTMLElement} */ (form.querySelector("#level-hint"));
  const [plainLevels, otherLevels] = /** @type {NodeListOf<HTMLElement>} */ (form.querySelectorAll(".levels"));
  const others = /** @type {HTMLDetailsElement} */ (form.querySelector(".more-levels"));
  const custom = /** @type {HTMLElement} */ (form.querySelector(".custom"));
  const drawn = /** @type {NodeListOf<HTMLElement>} */ (form.querySelectorAll("[data-drawn]"));
  /** @type {Answers.Level[]} */
  let levels = [];
  /** @type {Answers.Map[]} */
  let maps = [];
  const read = () => readWish(/** @type {Record<string, string>} */ (Object.fromEntries(new FormData(form))));
  const choices = () => /** @type {HTMLButtonElement[]} */ ([...plainLevels.children, ...otherLevels.children]);
  function follow() {
    const { value } = input("level");
    for (const button of choices()) button.setAttribute("aria-pressed", String(button.value === value));
    for (const each of drawn) each.hidden = value.startsWith(MAP);
    /** @type {HTMLFieldSetElement} */ (form.querySelector("fieldset")).disabled = value.startsWith(MAP);
    input("seed").disabled = value.startsWith(MAP);
    custom.hidden = input("rows").disabled = input("cols").disabled = side.value !== "custom";
    hint.textContent = (levels.find(({ name }) => name === value) ?? maps.find(({ name }) => MAP + name === value))?.summary?.replace(" (section 3.2)", "") ?? "";
  }
  form.addEventListener("change", follow);
  for (const group of [plainLevels, otherLevels]) {
    group.addEventListener("click", ({ target }) => {
      const button = /** @type {Element} */ (target).closest("button");
      if (!button) return;
      input("level").value = button.value;
      follow();
    });
  }
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
    /** @param {Answers.Level[]} found @param {{name: string, summary: string}[]} policies @param {Answers.Map[]} given */
    offer(found, policies, given) {
      levels = found;
      maps = given;
      const first = firstWish(policies);
      const { plain, paper } = levelGroups(found.map(({ name }) => name));
      const pictureOf = (/** @type {string} */ name) => picture(/** @type {Answers.Level} */ (found.find((level) => level.name === name)));
      plainLevels.replaceChildren(...plain.map(pictureOf));
      otherLevels.replaceChildren(...paper.map(pictureOf), ...maps.map(mapChoice));
      fill(select("rival"), policies, first.rival);
      fill(select("player"), policies, first.player);
      follow();
    },
    /** Show what is being played. A chosen seed serves one terrain, and the server draws the next.
     * @param {About} about */
    show({ level, map, frame: shown, player, rival }) {
      const frame = /** @type {Mars.Frame} */ (shown);
      input("seed").value = "";
      const value = map ? MAP + map : level;
      const isOffered = choices().some((button) => button.value === value);
      input("level").value = isOffered ? value : "random"; // a map that is not on offer any more
      others.open = [...otherLevels.children].some((button) => /** @type {HTMLButtonElement} */ (button).value === value);
      const isSquare = frame.rows === frame.cols && [21, 42, 84].includes(frame.rows);
      const isDrawn = Math.max(frame.rows, frame.cols) <= LONGEST_SIDE; // a map may be larger
      side.value = isSquare ? String(frame.rows) : isDrawn ? "custom" : "21";
      if (side.value === "custom") [input("rows").value, input("cols").value] = [String(frame.rows), String(frame.cols)];
      if (rival) select("rival").value = rival.policy;
      if (player !== "human") select("player").value = player;
      follow();
    },
  };
}
