// What the page of the playground is filled with, touched only where it changed: boards' words and numbers, the top bar; and what stands on the end card.
import { all, by, create, paintLink, put } from "../common/page.js";
import { paintNumbers } from "../common/task.js";
import { many, within } from "../common/words.js";
import { challengeHash } from "./address.js";

/** Return what stands on the end card of the player's board.
 * @param {Frame} frame of its end @param {Task} task @param {GameState} state
 * @param {{tried: string, own: string}} compared with the episode that was tried again, and with the player's others
 * @returns {import("../common/end_card.js").Content} */
export function endOf(frame, task, { mode, player, rival }, { tried, own }) {
  const who = mode === "watch" ? task.nameOf(player?.name ?? "") : "You";
  const compared = task.compare(frame, rival?.frame ?? null, task.nameOf(rival?.name ?? ""));
  return {
    ...task.ending(frame), ...task.verdict?.(frame, rival?.frame ?? null, task.nameOf(rival?.name ?? ""), mode === "watch" ? who : null), compare: [tried, compared].filter(Boolean).join(" "), own,
    next: `Next ${task.round}`, again: mode !== "ranked", // a terrain counts once
    replay: `replay/${encodeURIComponent(frame.episode)}`, copy: true, beat: task.successes.includes(frame.outcome ?? "") ? challengeHash(frame.episode) : undefined, // a crash is no mark to beat
  };
}

/** Return the panel of a board, its parts named and marked for tests.
 * @param {HTMLElement} root @returns {Play.Panel} */
export function createPanel(root) {
  const role = /** @type {Role} */ (root.dataset.role);
  /** @type {Record<string, HTMLElement>} */
  const part = {};
  for (const element of all("[data-part]", root)) {
    const name = element.dataset.part ?? "";
    part[name] = element;
    element.dataset.testid = `${name}-${role}`;
  }
  for (const button of all("[data-pace]", root)) button.dataset.testid = `pace-${button.dataset.pace}-${role}`;
  return { role, root, part, canvas: /** @type {HTMLCanvasElement} */ (part.canvas), viewer: /** @type {HTMLIFrameElement} */ (part.viewer) };
}

/** Paint the numbers of one board.
 * @param {Play.Panel} panel @param {Task} task @param {Board | null} board */
export function paintPanel({ role, root, part }, task, board) {
  root.classList.toggle("is-empty", !board);
  put(part.name, board ? task.nameOf(board.name) : role === "player" ? "You" : "Policy");
  if (!board) return;
  const { share } = paintNumbers(part, task, board.frame);
  put(part.outcome, task.outcome(board.frame.outcome));
  root.style.setProperty("--share", String(share));
  root.dataset.outcome = board.frame.outcome ?? "running";
}

/** Say on a board what it waits for.
 * @param {Play.Panel} panel @param {GameState["notices"]} notices */
export function paintWaits({ role, part }, notices) {
  put(part.waits, notices.filter((notice) => notice.role === role).map(({ text }) => text).join(" "));
}

/** Offer the policies that a board can be given.
 * @param {Play.Panel} panel @param {Task} task @param {string[]} names */
export function offerPolicies({ part }, task, names) {
  part.pick.replaceChildren(...names.map((name) => new Option(task.nameOf(name), name)));
}

/** Paint the choice of a policy in the place of its name; a person's board has none, nor what is to be beaten.
 * @param {Play.Panel} panel @param {Board | null} board */
export function paintPick({ part }, board) {
  const pick = /** @type {HTMLSelectElement} */ (part.pick);
  const isOffered = Boolean(board?.session) && [...pick.options].some(({ value }) => value === board?.name);
  pick.hidden = !isOffered;
  part.name.classList.toggle("unseen", isOffered);
  if (board && isOffered && pick.value !== board.name) pick.value = board.name;
}

/** Paint the pace of a policy's board.
 * @param {Play.Panel} panel @param {Board | null} board @param {boolean} mayFollow true where there is a player to follow */
export function paintPace({ part }, board, mayFollow) {
  const pace = board?.pace;
  part.pace.hidden = !pace;
  if (!pace) return;
  for (const button of all("[data-pace]", part.pace)) {
    if (button.dataset.pace !== "step") button.setAttribute("aria-pressed", String(button.dataset.pace === pace.mode));
    if (button.dataset.pace === "follow") button.hidden = !mayFollow;
  }
  const speed = /** @type {HTMLElement} */ (part.pace.querySelector(".speed"));
  speed.classList.toggle("is-idle", pace.mode !== "timed");
  const slider = /** @type {HTMLInputElement} */ (speed.querySelector("input"));
  if (pace.mode === "timed" && document.activeElement !== slider) slider.value = String(pace.moves_per_second);
  put(/** @type {HTMLElement} */ (speed.querySelector("output")), `${slider.value}/s`);
}

/** @type {Record<string, Record<string, unknown>>} */
const WISHES = { follow: { follow: true }, paused: { pause: true }, step: { step: true } };

/** @param {HTMLElement} bar @param {(wish: Record<string, unknown>) => void} ask what POST api/sessions/{id}/pace takes */
export function startPace(bar, ask) {
  const slider = /** @type {HTMLInputElement} */ (bar.querySelector("input"));
  const askSpeed = () => ask({ moves_per_second: Number(slider.value) });
  bar.addEventListener("click", (event) => {
    const button = /** @type {Element} */ (event.target).closest("[data-pace]");
    const chosen = /** @type {HTMLElement | null} */ (button)?.dataset.pace;
    if (chosen === "timed") askSpeed();
    else if (chosen) ask(WISHES[chosen]);
  });
  slider.addEventListener("input", () => bar.querySelector("output")?.replaceChildren(`${slider.value}/s`));
  slider.addEventListener("change", askSpeed);
  // A slider left focused by the pointer would keep the arrow keys from the board.
  slider.addEventListener("pointerup", () => slider.blur());
}

/** Paint the mode, the badge, the terrain, the connection, and whose the boards and colours are.
 * @param {GameState} state @param {string} rival the policy that will play after a ranked episode */
export function paintBar(state, rival) {
  const { task, player } = state;
  for (const button of all("button[data-mode]")) button.setAttribute("aria-pressed", String(button.dataset.mode === state.mode));
  by("badge").hidden = !state.counts;
  const place = task && player ? task.place(state.level, player.frame) : "";
  put(by("terrain"), state.mode === "challenge" ? `Challenge \u00b7 ${place}` : place);
  paintLink(by("link"), state.link, "live");
  if (task) put(by("goal"), task.goal(player?.frame ?? null));
  if (task) paintStanding(by("standing"), standing(state, rival));
  const named = (/** @type {Board | null} */ board) => (task && board && state.mode === "watch" ? task.nameOf(board.name) : null);
  put(by("tab-player"), named(player) ?? "You");
  const beside = task && state.mode === "challenge" && state.rival ? task.nameOf(state.rival.name) : named(state.rival);
  const driver = beside ?? (task && state.rival ? task.nameOf(state.rival.name) : "Policy");
  put(by("tab-rival"), state.rival && state.mode !== "watch" ? `${driver}: ${many(state.rival.frame.step, "move")}` : driver);
  for (const name of all("[data-of=player]")) put(name, named(player) ?? "you");
  for (const name of all("[data-of=rival]")) put(name, within(beside ?? "policy"));
  document.body.dataset.mode = state.mode;
  document.body.dataset.ended = String(Boolean(player?.frame.outcome));
}

/** Return what stands below the goal while one board fills the page: what everybody reads, and what a phone leaves out.
 * @param {GameState} state @param {string} rival @returns {[string, string]} */
export function standing({ mode, counts, player, rival: other, task }, rival) {
  const beside = other && task?.nameOf(other.name);
  if (mode !== "ranked" || !player) return [task?.standing ?? "", mode === "practice" && beside ? ` ${task?.beside?.(beside) ?? ""}` : ""];
  const after = rival ? ` After the end, ${task?.nameOf(rival) ?? rival} plays the same ${task?.round} beside you.` : "";
  if (!counts) return [`This episode does not count: you have met its ${task?.round} before, or a script has moved.`, after];
  return ["This ranked episode counts from your first move on, however it ends.", ` Leaving it, or a long time without a move, counts as abandoned.${after}`];
}

/** @param {HTMLElement} place @param {[string, string]} parts of `standing` */
function paintStanding(place, [first, later]) {
  if (place.textContent !== first + later) place.replaceChildren(first, create("span", later, { class: "later" }));
}

/** Return whether the page shows the policy's board: a first visit and a ranked episode have the player's alone until
 * the end.
 * @param {GameState} state @param {boolean} isFirstVisit */
export function hasTwoBoards({ mode, player, rival }, isFirstVisit) {
  if (mode === "watch") return true;
  if (!player) return !isFirstVisit;
  return rival !== null && !isFirstVisit;
}

/** Return whether nothing has been done on a player's board, or it is still to come: what is to be done stands beside it.
 * @param {GameState} state */
export const isFresh = ({ mode, player }) => mode !== "watch" && (!player || (player.frame.step === 0 && !player.frame.outcome));

/** Let the buttons of a small screen choose what is on it: the player's board, the policy's, or both maps with the chart.
 * @returns {(name: string) => void} shows one of them */
export function startTabs() {
  const buttons = all("[data-show]");
  /** @param {string} name */
  function show(name) {
    document.body.dataset.tab = name;
    for (const button of buttons) button.setAttribute("aria-pressed", String(button.dataset.show === name));
  }
  for (const button of buttons) button.addEventListener("click", () => show(button.dataset.show ?? "player"));
  return show;
}

/** @param {Play.Panel} panel @returns whether its matrix has the stage: in 3-D it is the small map */
export const hasStage = ({ viewer }) => document.body.dataset.view !== "3d" || !viewer.hasAttribute("data-drawn");

/** Open and close a dialog by its buttons, or by a click beside it.
 * @param {string} name */
export function startDialog(name) {
  const dialog = by(`${name}-dialog`, HTMLDialogElement);
  const open = by(`open-${name}`, HTMLButtonElement);
  open.disabled = false;
  open.addEventListener("click", () => dialog.showModal());
  by(`close-${name}`).addEventListener("click", () => dialog.close());
  dialog.addEventListener("click", (event) => event.target === dialog && dialog.close());
  return dialog;
}
