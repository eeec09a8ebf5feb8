// @ts-check
// What stands round the boards: the top bar, the sentence below the goal, the choice of what a small screen shows, the
// help, and the volunteers' figure at the foot.
import { elementsOf, paintLink, put } from "../common/page.js";
import { figure, notCounted, sizeText } from "../common/words.js";
import { goal, standing } from "./words.js";

/** Paint the mode, the badge, the terrain, the connection, and whose the boards and colours are.
 * @param {GameState} state @param {Document} page
 * @param {string} rival the policy that will play after a ranked episode */
export function paintBar(state, page, rival) {
  const by = elementsOf(page);
  for (const button of /** @type {NodeListOf<HTMLElement>} */ (page.querySelectorAll("button[data-mode]"))) {
    button.setAttribute("aria-pressed", String(button.dataset.mode === state.mode));
  }
  const badge = by("badge");
  badge.dataset.counts = String(state.counts);
  put(badge, state.counts ? "counts" : state.mode === "watch" ? "watching" : "practice");
  badge.title = state.counts ? "This episode counts for the volunteers' figure." : "This episode does not count.";
  put(by("terrain"), state.player ? `${state.level} \u00b7 ${sizeText([state.player.frame.rows, state.player.frame.cols])}` : "");
  paintLink(by("link"), state.link, "live");
  put(by("goal"), goal(state.player?.frame ?? null));
  put(by("standing"), standing(state, rival));
  const watched = state.mode === "watch" ? state : null;
  put(by("tab-player"), watched?.player?.name ?? "You");
  put(by("tab-rival"), watched?.rival?.name ?? "Policy");
  put(by("key-player"), watched?.player?.name ?? "you");
  put(by("key-rival"), watched?.rival?.name ?? "policy");
  page.body.dataset.mode = state.mode;
  page.body.dataset.ended = String(Boolean(state.player?.frame.outcome));
}

/** Return whether the page shows the policy's board: a first visit and a ranked episode have the player's alone until
 * the end.
 * @param {GameState} state @param {boolean} isFirstVisit */
export function hasTwoBoards({ mode, player, rival }, isFirstVisit) {
  if (mode === "watch") return true;
  if (!player) return !isFirstVisit;
  return rival !== null && !isFirstVisit;
}

/** Let the buttons of a small screen choose what is on it: the player's board, the policy's, or both maps with the
 * chart.
 * @param {Document} page @returns {(name: string) => void} shows one of them */
export function startTabs(page) {
  const buttons = /** @type {HTMLElement[]} */ ([...page.querySelectorAll("[data-show]")]);
  /** @param {string} name */
  function show(name) {
    page.body.dataset.tab = name;
    for (const button of buttons) button.setAttribute("aria-pressed", String(button.dataset.show === name));
  }
  for (const button of buttons) button.addEventListener("click", () => show(button.dataset.show ?? "player"));
  return show;
}

/** Open the help by its button and by the key "?", outside fields and other dialogs.
 * @param {Document} page */
export function startHelp(page) {
  const by = elementsOf(page);
  const dialog = by("help-dialog", HTMLDialogElement);
  by("open-help").addEventListener("click", () => dialog.showModal());
  by("close-help").addEventListener("click", () => dialog.close());
  dialog.addEventListener("click", (event) => event.target === dialog && dialog.close());
  page.addEventListener("keydown", (event) => {
    if (event.key !== "?" || event.ctrlKey || event.metaKey || page.querySelector("dialog[open]")) return;
    if (/** @type {Element} */ (event.target).closest("input, select, textarea")) return;
    event.preventDefault();
    dialog.showModal();
  });
}

/** @param {{page: Document, api: Pick<ReturnType<import("../common/api.js").createApi>, "about" | "humanLevel">,
 *   state: () => GameState, dispatch: (event: GameEvent) => void}} how */
export function createVolunteers({ page, api, state, dispatch }) {
  const by = elementsOf(page);

  /** Ask for the figure and paint it: that of the terrain being played, and the server's sentence. */
  async function load() {
    const answer = await api.humanLevel().catch(() => null);
    if (!answer) return;
    const { level, player } = state();
    const found = answer.figures.find((each) => each.level === level && each.rows === player?.frame.rows && each.cols === player?.frame.cols);
    const line = by("human-figure");
    line.hidden = !found;
    if (found) put(line, figure(found));
    put(by("human-level"), answer.sentence);
  }
  return {
    load,
    /** Say after the end of an episode that was to count when it does not, and show the figure with it or without it. */
    async ended() {
      const { mode, counts, player } = state();
      const about = mode === "ranked" && counts && player ? await api.about(player.session).catch(() => null) : null;
      if (about?.not_attested) {
        dispatch({ kind: "begun", about });
        dispatch({ kind: "notice", text: notCounted(about.not_attested), tone: "note" });
      }
      await load();
    },
  };
}
