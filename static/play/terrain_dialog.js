// @ts-check
// The sheet on which a terrain and the policies are chosen.

/** @typedef {{level: string, size: number | [number, number], seed: number | null, rival: string, player: string}} Wish */
export const MAX_SEED = 2 ** 53 - 1;

/**
 * The wish that a filled sheet stands for, or a sentence that says what is wrong.
 * @param {Record<string, string>} fields
 * @returns {Wish | string}
 */
export function readWish({ level, side, rows, cols, seed, rival, player }) {
  /** @type {number | [number, number]} */
  let size = Number(side);
  if (side === "custom") {
    size = [Number(rows), Number(cols)];
    const wrong = size.find((length) => !Number.isInteger(length) || length < 5 || length > 128);
    if (wrong !== undefined) return `Rows and columns must be whole numbers from 5 to 128, got ${rows} and ${cols}.`;
  }
  const digits = seed.trim();
  if (digits && (!/^[0-9]+$/.test(digits) || Number(digits) > MAX_SEED)) return `A seed is a whole number from 0 to ${MAX_SEED}, got ${digits}.`;
  return { level, size, seed: digits ? Number(digits) : null, rival, player };
}

/**
 * The policy that plays beside a newcomer.
 * @param {string[]} names
 */
export function favourite(names) {
  return names.find((name) => name.includes("ppo")) ?? names.find((name) => name === "frontier-utility") ?? names.at(-1) ?? "";
}

/**
 * @param {HTMLSelectElement} select
 * @param {{name: string, summary?: string}[]} choices
 * @param {string} chosen
 */
function fill(select, choices, chosen) {
  select.replaceChildren(...choices.map(({ name }) => new Option(name, name, false, name === chosen)));
}

/**
 * @param {HTMLDialogElement} dialog
 * @param {{onStart: (wish: Wish) => void, onWrong: (sentence: string) => void,
 *   onPad: (isShown: boolean) => void}} tell
 */
export function createSheet(dialog, tell) {
  const form = /** @type {HTMLFormElement} */ (dialog.querySelector("form"));
  const field = (/** @type {string} */ name) => /** @type {any} */ (form.elements.namedItem(name));
  const hint = /** @type {HTMLElement} */ (form.querySelector("#level-hint"));
  const custom = /** @type {HTMLElement} */ (form.querySelector(".custom"));
  /** @type {{name: string, summary: string}[]} */
  let levels = [];
  const read = () => readWish(/** @type {any} */ (Object.fromEntries(new FormData(form))));
  function follow() {
    custom.hidden = field("side").value !== "custom";
    hint.textContent = levels.find(({ name }) => name === field("level").value)?.summary ?? "";
  }
  form.addEventListener("change", (event) => {
    follow();
    if (event.target === field("pad")) tell.onPad(field("pad").checked);
  });
  form.addEventListener("submit", (event) => {
    const wish = read();
    if (typeof wish !== "string") return tell.onStart(wish);
    event.preventDefault();
    dialog.close();
    tell.onWrong(wish);
  });
  form.querySelector("#close-sheet")?.addEventListener("click", () => dialog.close());
  dialog.addEventListener("click", (event) => event.target === dialog && dialog.close());
  return {
    open: () => dialog.showModal(),
    /**
     * The wish as it stands; a wrong sheet counts as an untouched one.
     * @returns {Wish}
     */
    wish() {
      const wish = read();
      return typeof wish === "string" ? { level: "random", size: 21, seed: null, rival: field("rival").value, player: field("player").value } : wish;
    },
    /**
     * Chooses the policy of a board.
     * @param {import("../common/game_state.js").Seat} seat
     * @param {string} name
     */
    choose(seat, name) { field(seat).value = name; },
    /** A chosen seed serves one terrain; the next is drawn by the server again. */
    forgetSeed() { field("seed").value = ""; },
    /**
     * @param {{name: string, summary: string}[]} found
     * @param {{name: string, summary: string}[]} policies
     */
    offer(found, policies) {
      levels = found;
      const names = policies.map(({ name }) => name);
      const best = favourite(names);
      fill(field("level"), found, "random");
      fill(field("rival"), policies, best);
      fill(field("player"), policies, names.find((name) => name !== best && name.includes("frontier")) ?? best);
      follow();
    },
    /**
     * Shows what is being played, after a reload.
     * @param {import("../common/messages.js").About} about
     */
    show({ level, frame, player, rival }) {
      field("level").value = level;
      const side = frame.rows === frame.cols && [21, 42, 84].includes(frame.rows) ? String(frame.rows) : "custom";
      field("side").value = side;
      if (side === "custom") [field("rows").value, field("cols").value] = [frame.rows, frame.cols];
      if (rival) field("rival").value = rival.policy;
      if (player !== "human") field("player").value = player;
      follow();
    },
    /** @param {boolean} isShown */
    showPad(isShown) { field("pad").checked = isShown; },
  };
}
