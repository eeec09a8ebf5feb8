// @ts-check
// The volunteers' figure at the foot of the page, and whether the episode that has just ended is part of it.
import { elementsOf, put } from "../common/page.js";
import { figure, notCounted } from "../common/words.js";

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
