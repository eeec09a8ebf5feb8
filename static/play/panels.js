// @ts-check
// One board's words and numbers: the elements made from the template, filled from the state, touched only where they changed.
import * as words from "../common/words.js";
import { elementsOf, paintLink, put } from "../common/page.js";

/**
 * @typedef {import("../common/game_state.js").Board} Board
 * @typedef {import("../common/game_state.js").State} State
 * @typedef {import("../common/game_state.js").Role} Role
 */
/**
 * @typedef {{role: Role, root: HTMLElement, part: Record<string, HTMLElement>, canvas: HTMLCanvasElement, viewer: HTMLIFrameElement}} Panel
 */

/**
 * Make the panel of a board, its parts named and marked for tests.
 * @param {HTMLElement} root
 * @param {HTMLTemplateElement} template
 * @returns {Panel}
 */
export function createPanel(root, template) {
  root.append(template.content.cloneNode(true));
  const role = /** @type {Role} */ (root.dataset.role);
  /** @type {Record<string, HTMLElement>} */
  const part = {};
  for (const element of /** @type {NodeListOf<HTMLElement>} */ (root.querySelectorAll("[data-part]"))) {
    const name = element.dataset.part ?? "";
    part[name] = element;
    element.dataset.testid = `${name}-${role}`;
  }
  for (const button of /** @type {NodeListOf<HTMLElement>} */ (root.querySelectorAll("[data-pace]"))) button.dataset.testid = `pace-${button.dataset.pace}-${role}`;
  if (role === "player") {
    part.end.dataset.testid = "end-card";
    part.next.dataset.testid = "next-terrain";
    part.again.dataset.testid = "same-again";
    part.fold.addEventListener("click", (event) => {
      fold(part, !part.end.classList.contains("is-folded"));
      if (event.detail > 0) part.next.focus({ preventScroll: true }); // a mouse or a finger; Enter still means the next terrain
    });
  }
  return { role, root, part, canvas: /** @type {HTMLCanvasElement} */ (part.canvas), viewer: /** @type {HTMLIFrameElement} */ (part.viewer) };
}

/**
 * Shrink the end card to its buttons, so that the board below it can be seen, or bring it back.
 * @param {Record<string, HTMLElement>} part
 * @param {boolean} isFolded
 */
function fold(part, isFolded) {
  part.end.classList.toggle("is-folded", isFolded);
  part.fold.setAttribute("aria-expanded", String(!isFolded));
  put(part.fold, isFolded ? "More" : "Less");
}

/**
 * Paint the numbers of one board.
 * @param {Panel} panel
 * @param {Board | null} board
 * @param {string} brief what stands in the place of a missing board
 */
export function paintPanel({ root, part, canvas }, board, brief) {
  root.classList.toggle("is-empty", !board);
  part.brief.hidden = Boolean(board);
  if (!board) {
    put(part.name, "Rival");
    put(part.brief, brief);
    return;
  }
  const { frame } = board;
  put(part.name, board.name);
  put(part.steps, String(frame.step));
  put(part.coverage, words.percent(frame.coverage));
  put(part.score, words.score(frame.score));
  put(part.reward, words.signed(frame.reward));
  put(part.return, words.signed(frame.return));
  put(part.outcome, words.outcomeShort(frame.outcome));
  root.dataset.outcome = frame.outcome ?? "running";
  canvas.setAttribute("aria-label", words.describeBoard(frame, board.name));
}

/**
 * Offer the policies that a board can be given.
 * @param {Panel} panel
 * @param {string[]} names
 */
export function offerPolicies({ part }, names) {
  part.pick.replaceChildren(...names.map((name) => new Option(name, name)));
}

/**
 * Paint the choice of a policy in the place of its name; a person's board has none.
 * @param {Panel} panel
 * @param {Board | null} board
 */
export function paintPick({ part }, board) {
  const pick = /** @type {HTMLSelectElement} */ (part.pick);
  const isOffered = Boolean(board) && [...pick.options].some(({ value }) => value === board?.name);
  pick.hidden = !isOffered;
  part.name.classList.toggle("unseen", isOffered);
  if (board && isOffered && pick.value !== board.name) pick.value = board.name;
}

/**
 * Paint the pace of a policy's board.
 * @param {Panel} panel
 * @param {Board | null} board
 * @param {boolean} mayFollow true where there is a player to follow
 */
export function paintPace({ part }, board, mayFollow) {
  const pace = board?.pace;
  part.pace.hidden = !pace;
  if (!pace) return;
  for (const button of /** @type {NodeListOf<HTMLButtonElement>} */ (part.pace.querySelectorAll("[data-pace]"))) {
    if (button.dataset.pace !== "step") button.setAttribute("aria-pressed", String(button.dataset.pace === pace.mode));
    if (button.dataset.pace === "follow") button.hidden = !mayFollow;
  }
  const speed = /** @type {HTMLElement} */ (part.pace.querySelector(".speed"));
  speed.classList.toggle("is-idle", pace.mode !== "timed");
  const slider = /** @type {HTMLInputElement} */ (speed.querySelector("input"));
  if (pace.mode === "timed" && document.activeElement !== slider) slider.value = String(pace.moves_per_second);
  put(/** @type {HTMLElement} */ (speed.querySelector("output")), `${slider.value}/s`);
}

/**
 * Paint the end card of the player's board; return whether it has just appeared.
 * @param {Panel} panel
 * @param {State} state
 */
export function paintEnd({ part }, state) {
  const frame = state.player?.frame;
  const wasHidden = part.end.hidden;
  part.end.hidden = !frame?.outcome || state.mode === "spectator";
  if (!frame || part.end.hidden) return false;
  if (wasHidden) fold(part, false);
  const goal = words.stepsToGoal(frame);
  put(part["end-title"], words.outcomeTitle(frame.outcome));
  put(part["end-line"], words.outcomeLine(frame.outcome));
  put(part["end-steps"], String(goal ?? frame.rows * frame.cols));
  put(part["end-missed"], " (not reached)");
  part["end-missed"].hidden = goal !== null;
  put(part["end-score"], words.score(frame.score));
  const { rival, mode, player } = state;
  const compared = words.compare(frame, rival?.frame ?? null, rival?.name ?? "", mode === "watch" ? player?.name : "You");
  put(part["end-compare"], compared || (mode === "ranked" ? "A policy is starting on the same terrain." : ""));
  part.again.hidden = mode === "ranked";
  return wasHidden;
}

/**
 * Paint the top bar: mode, badge, terrain, connection.
 * @param {State} state
 * @param {Document} page
 */
export function paintBar(state, page) {
  const by = elementsOf(page);
  for (const button of /** @type {NodeListOf<HTMLElement>} */ (page.querySelectorAll("button[data-mode]"))) {
    button.setAttribute("aria-pressed", String(button.dataset.mode === state.mode));
  }
  const badge = by("badge");
  badge.dataset.counts = String(state.counts);
  const isWatching = state.mode === "watch" || state.mode === "spectator";
  put(badge, state.counts ? "counts" : isWatching ? "watching" : "practice");
  badge.title = state.counts ? "This episode counts for the volunteers' figure." : "This episode does not count.";
  put(by("terrain"), state.player ? `${state.level} \u00b7 ${words.sizeText([state.player.frame.rows, state.player.frame.cols])}` : "");
  paintLink(by("link"), state.link, "live");
  put(by("dock-steps"), String(state.player?.frame.step ?? 0));
  put(by("dock-coverage"), words.percent(state.player?.frame.coverage ?? 0));
  page.body.dataset.mode = state.mode;
  by("watching").hidden = state.mode !== "spectator";
  page.body.dataset.ended = String(Boolean(state.player?.frame.outcome));
}

/**
 * Paint the volunteers' figure: that of the terrain being played, and the server's sentence.
 * @param {import("../common/api.js").HumanLevel} level
 * @param {State} state
 * @param {Document} page
 */
export function paintHumanLevel({ figures, sentence }, state, page) {
  const frame = state.player?.frame;
  const figure = figures.find((each) => each.level === state.level && each.rows === frame?.rows && each.cols === frame?.cols);
  const by = elementsOf(page);
  const line = by("human-figure");
  line.hidden = !figure;
  if (figure) put(line, words.figure(figure));
  put(by("human-level"), sentence);
}
