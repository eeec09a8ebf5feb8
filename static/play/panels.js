// @ts-check
// One board's words and numbers: the elements made from the template, filled from the state, touched only where they changed.
import { put } from "../common/page.js";
import { signed } from "../common/words.js";

/** Make the panel of a board, its parts named and marked for tests.
 * @param {HTMLElement} root @param {HTMLTemplateElement} template
 * @param {HTMLElement[]} [elsewhere] what belongs to the board and stands outside of it @returns {Play.Panel} */
export function createPanel(root, template, elsewhere = []) {
  root.append(template.content.cloneNode(true));
  const role = /** @type {Role} */ (root.dataset.role);
  /** @type {Record<string, HTMLElement>} */
  const part = {};
  const found = [root, ...elsewhere].flatMap((place) => [place, ...place.querySelectorAll("[data-part]")]);
  for (const element of /** @type {HTMLElement[]} */ (found.filter((each) => each.hasAttribute("data-part")))) {
    const name = element.dataset.part ?? "";
    part[name] = element;
    element.dataset.testid = `${name}-${role}`;
  }
  for (const button of /** @type {NodeListOf<HTMLElement>} */ (root.querySelectorAll("[data-pace]"))) button.dataset.testid = `pace-${button.dataset.pace}-${role}`;
  if (role === "player") {
    part.end.dataset.testid = "end-card";
    part.next.dataset.testid = "next-terrain";
    part.again.dataset.testid = "same-again";
    part["replay-link"].dataset.testid = "watch-replay";
    part["copy-replay"].dataset.testid = "copy-replay";
  }
  return { role, root, part, canvas: /** @type {HTMLCanvasElement} */ (part.canvas), viewer: /** @type {HTMLIFrameElement} */ (part.viewer) };
}

/** Paint the numbers of one board.
 * @param {Play.Panel} panel @param {Task} task @param {Board | null} board */
export function paintPanel({ role, root, part }, task, board) {
  root.classList.toggle("is-empty", !board);
  put(part.name, board?.name ?? (role === "player" ? "You" : "Policy"));
  if (!board) return;
  paintNumbers(root, part, task, board.frame);
  put(part.reward, signed(board.frame.reward));
  put(part.return, signed(board.frame.return));
}

/** Paint moves, headline and outcome.
 * @param {HTMLElement} root @param {Record<string, HTMLElement>} part @param {Task} task @param {Frame} frame */
export function paintNumbers(root, part, task, frame) {
  const { value, unit, share } = task.headline(frame);
  put(part.steps, String(frame.step));
  put(part["steps-name"], frame.step === 1 ? "move" : "moves");
  put(part.coverage, value);
  put(part.unit, unit);
  put(part.outcome, task.outcome(frame.outcome));
  root.style.setProperty("--share", String(share));
  root.dataset.outcome = frame.outcome ?? "running";
}

/** Offer the policies that a board can be given.
 * @param {Play.Panel} panel @param {string[]} names */
export function offerPolicies({ part }, names) {
  part.pick.replaceChildren(...names.map((name) => new Option(name, name)));
}

/** Paint the choice of a policy in the place of its name; a person's board has none.
 * @param {Play.Panel} panel @param {Board | null} board */
export function paintPick({ part }, board) {
  const pick = /** @type {HTMLSelectElement} */ (part.pick);
  const isOffered = Boolean(board) && [...pick.options].some(({ value }) => value === board?.name);
  pick.hidden = !isOffered;
  part.name.classList.toggle("unseen", isOffered);
  if (board && isOffered && pick.value !== board.name) pick.value = board.name;
}

/** Paint the pace of a policy's board.
 * @param {Play.Panel} panel @param {Board | null} board
 * @param {boolean} mayFollow true where there is a player to follow */
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

/** @type {Record<string, Record<string, unknown>>} */
const WISHES = { follow: { follow: true }, paused: { pause: true }, step: { step: true } };

/** @param {HTMLElement} bar
 * @param {(wish: Record<string, unknown>) => void} ask what POST api/sessions/{id}/pace takes */
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
