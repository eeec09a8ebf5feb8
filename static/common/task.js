// The task of a page: its module, and the parts of the page that differ from task to task.
import { request } from "./api.js";
import { create, put } from "./page.js";
import { fixed, t } from "./texts.js";
import { actionText, capital } from "./words.js";

/** Return what a page knows of a task: of the one that the server plays where none is named.
 * @param {Answers.Task} [about] @returns {Promise<Task>} */
export async function loadTask(about) {
  const task = about ?? /** @type {Answers.Task} */ (await request("task"));
  const { taskOf } = await import(`../task/${task.assets}/index.js`);
  return taskOf(task);
}

/** Say why an action cannot be chosen on a frame; null where it can.
 * @param {Pick<Task, "allowed">} task @param {Frame} frame @param {Action} action */
export function forbidden(task, frame, action) {
  const allowed = task.allowed?.(frame) ?? null;
  return allowed === null || allowed.includes(action) ? null : t("play.forbidden", "{action} cannot be chosen now", { action: capital(actionText(action)) });
}

/** Paint the buttons and the named keys of what cannot be chosen grey.
 * @param {Task} task @param {Frame} frame */
export function paintAllowed(task, frame) {
  if (!task.allowed) return;
  for (const part of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll(".pad [data-action], .keys [data-key-of]"))) {
    const action = part.dataset.action ?? part.dataset.keyOf ?? "";
    const isForbidden = String(frame.outcome === null && forbidden(task, frame, action) !== null);
    if (part.getAttribute("aria-disabled") !== isForbidden) part.setAttribute("aria-disabled", isForbidden);
  }
}

/** Return how long an episode has been, in moves or, where time runs, in seconds.
 * @param {Pick<Answers.Task, "clock">} task @param {number} step */
export const lengthOf = ({ clock }, step) => (clock ? fixed(step / clock, 1) : String(step));

/** Paint moves and headline of a board, and return the headline.
 * @param {Record<string, HTMLElement>} part @param {Task} task @param {Frame} frame */
export function paintNumbers(part, task, frame) {
  const headline = task.headline(frame);
  put(part.steps, lengthOf(task, frame.step));
  put(part["steps-name"], task.clock ? "seconds" : frame.step === 1 ? "move" : "moves");
  put(part.coverage, headline.value);
  put(part.unit, headline.unit);
  return headline;
}

const DIRECTIONS = { ArrowUp: "M4 13l6-6 6 6", ArrowLeft: "M13 4l-6 6 6 6", ArrowDown: "M4 7l6 6 6-6", ArrowRight: "M7 4l6 6-6 6" };

/** @param {Keys} taskKeys @returns whether a swipe makes a move: it stands for the arrow key of its direction */
const hasSwipes = (taskKeys) => Object.values(taskKeys).flat().some((code) => code in DIRECTIONS);

/** Leave out of a page what it says of other tasks, and put the task's actions on the pad.
 * @param {Task} task @param {boolean} [isWorded] whether the page came in the task's own words */
export function showTask({ order, keys, chart, parts, round, has_boards: hasBoards }, isWorded = false) {
  for (const link of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("[data-of-boards]"))) link.hidden = !hasBoards;
  for (const part of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("[data-swipe]"))) part.hidden = !hasSwipes(keys);
  if (round !== "terrain" && !isWorded) renameTerrain(round);
  if (!parts) document.body.dataset.view = "matrix";
  for (const name of document.querySelectorAll("[data-part=chart-title]")) name.textContent = chart.title;
  const pad = document.querySelector(".pad");
  const there = [.../** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll(".pad [data-action]"))].map(({ dataset }) => dataset.action);
  if (!pad || String(there) === String(order)) return; // the page came with them
  const isRow = !order.every((action) => keys[action]?.[0] in DIRECTIONS);
  pad.classList.toggle("is-row", isRow);
  const rank = (/** @type {string} */ action) => [...Object.keys(DIRECTIONS), keys[action]?.[0]].indexOf(keys[action]?.[0]);
  const buttons = isRow ? [...order].sort((one, other) => rank(one) - rank(other)) : order; // left is left of right
  pad.replaceChildren(...buttons.map((action) => padButton(action, keys[action]?.[0] ?? "")));
}

/** Say a task's own word wherever a page says "terrain".
 * @param {string} word */
function renameTerrain(word) {
  const renamed = (/** @type {string | null} */ text) => (text ?? "").replace(/terrain/g, word).replace(/Terrain/g, capital(word));
  for (const part of document.querySelectorAll("[aria-label*=errain]")) part.setAttribute("aria-label", renamed(part.getAttribute("aria-label")));
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) if (/terrain/i.test(texts.currentNode.nodeValue ?? "")) texts.currentNode.nodeValue = renamed(texts.currentNode.nodeValue);
}

/** @param {Action} action @param {string} code of its first key */
function padButton(action, code) {
  const button = create("button", [], { type: "button", "data-action": action, "data-testid": `pad-${action}`, "aria-label": actionText(action) });
  const path = /** @type {Record<string, string>} */ (DIRECTIONS)[code];
  if (path) button.innerHTML = `<svg viewBox="0 0 20 20" aria-hidden="true"><path d="${path}"/></svg>`;
  else button.append(actionText(action));
  if (path) button.dataset.toward = code;
  return button;
}

const NAMES = { ArrowUp: "\u2191", ArrowRight: "\u2192", ArrowDown: "\u2193", ArrowLeft: "\u2190", Comma: ",", Period: ".", Slash: "/",
  Semicolon: ";", Quote: "'", BracketLeft: "[", BracketRight: "]", Backslash: "\\", Minus: "-", Equal: "=", Backquote: "`" };

/** @param {string} code @param {Study.Layout} [layout] of navigator.keyboard @returns what stands on a key */
export function keyName(code, layout) {
  const usual = /** @type {Record<string, string>} */ (NAMES)[code];
  const printed = code.startsWith("Arrow") ? usual : layout?.get(code) ?? usual;
  return (printed ?? code.replace(/^(Key|Digit)/, "").replace(/^Numpad/, "Num ")).toUpperCase().replace("NUM ", "Num ");
}

/** @param {boolean} isTouch @param {Keys} taskKeys @param {Keys} keys those that were chosen @returns what asks for the first move */
export function promptText(isTouch, taskKeys, keys) {
  const areArrows = (/** @type {Keys} */ codes) => Object.values(codes).every(([code]) => code in DIRECTIONS);
  if (isTouch) return `${hasSwipes(taskKeys) ? "Swipe or tap" : "Tap"} ${areArrows(taskKeys) ? "an arrow" : "a button"}`;
  return areArrows(keys) ? "Press an arrow key" : "Press one of your keys";
}
