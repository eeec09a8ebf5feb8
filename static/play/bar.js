// @ts-check
// What stands round the boards: the top bar, the sentence below the goal, the choice of what a small screen shows, the
// help, and the volunteers' figure at the foot.
import { elementsOf, paintLink, put } from "../common/page.js";
import { notCounted, score } from "../common/words.js";

/** Paint the mode, the badge, the terrain, the connection, and whose the boards and colours are.
 * @param {GameState} state @param {Document} page
 * @param {string} rival the policy that will play after a ranked episode */
export function paintBar(state, page, rival) {
  const { task, player } = state;
  const by = elementsOf(page);
  for (const button of /** @type {NodeListOf<HTMLElement>} */ (page.querySelectorAll("button[data-mode]"))) {
    button.setAttribute("aria-pressed", String(button.dataset.mode === state.mode));
  }
  const badge = by("badge");
  badge.dataset.counts = String(state.counts);
  put(badge, state.counts ? "counts" : state.mode === "watch" ? "watching" : "practice");
  badge.title = state.counts ? "This episode counts for the volunteers' figure." : "This episode does not count.";
  put(by("terrain"), task && player ? task.place(state.level, player.frame) : "");
  paintLink(by("link"), state.link, "live");
  if (task) put(by("goal"), task.goal(player?.frame ?? null));
  put(by("standing"), standing(state, rival));
  const watched = state.mode === "watch" ? state : null;
  put(by("tab-player"), watched?.player?.name ?? "You");
  put(by("tab-rival"), watched?.rival?.name ?? "Policy");
  put(by("key-player"), watched?.player?.name ?? "you");
  put(by("key-rival"), watched?.rival?.name ?? "policy");
  page.body.dataset.mode = state.mode;
  page.body.dataset.ended = String(Boolean(player?.frame.outcome));
}

/** @param {GameState} state @param {string} rival @returns what stands below the goal while one board fills the page */
export function standing({ mode, counts, player, task }, rival) {
  if (mode !== "ranked" || !player) return task?.standing ?? "";
  const what = counts ? "This ranked episode counts from your first move on, however it ends. Leaving it, or a long time without a move, counts as abandoned."
    : "This episode does not count: its terrain was chosen or met before, or a script has moved.";
  return rival ? `${what} After the end, ${rival} explores the same terrain beside you.` : what;
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

/** Open and close a dialog by its buttons, or by a click beside it.
 * @param {Document} page @param {string} name */
export function startDialog(page, name) {
  const by = elementsOf(page);
  const dialog = by(`${name}-dialog`, HTMLDialogElement);
  by(`open-${name}`).addEventListener("click", () => dialog.showModal());
  by(`close-${name}`).addEventListener("click", () => dialog.close());
  dialog.addEventListener("click", (event) => event.target === dialog && dialog.close());
  return dialog;
}

/** @param {{page: Document, api: Pick<ReturnType<import("../common/api.js").createApi>, "about" | "humanLevel">,
 *   state: () => GameState, dispatch: (event: GameEvent) => void}} how */
export function createVolunteers({ page, api, state, dispatch }) {
  const by = elementsOf(page);

  /** Ask for the figure and paint it: that of the terrain being played, and the server's sentence. */
  async function load() {
    const answer = await api.humanLevel().catch(() => null);
    if (!answer) return;
    const { level, player, task } = state();
    const shape = player && task ? String(task.shape(player.frame)) : "";
    const found = answer.figures.find((each) => each.level === level && `${each.cols},${each.rows}` === shape);
    const line = by("human-figure");
    line.hidden = !found;
    if (found) put(line, `${found.steps.mean.toFixed(1)} steps \u00b7 score ${score(found.score.mean)}`);
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
