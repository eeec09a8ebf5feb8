// The first episode of somebody who has never been here: the prompt for the first key, and the coach for the moves after it. The
// policy's board comes once that episode has ended.
import { put } from "../common/page.js";

/** @param {boolean} isTouch @returns what asks for the first move */
export const promptText = (isTouch) => (isTouch ? "Swipe or tap an arrow" : "Press an arrow key");

const VISITED = "mars.visited";

/** @param {{part: Record<string, HTMLElement>, isTouch: boolean,
 *   onEnded: () => void}} how */
export function createFirstVisit({ part, isTouch, onEnded }) {
  const { body } = document;
  /** @type {Set<string>} */
  const said = new Set();
  /** @type {Hint | null} */
  let hint = null;
  let isCoaching = true;
  const isFirst = () => body.dataset.visit === "first";

  /** @param {GameState} state */
  function paint({ mode, player, link }) {
    const isDriven = isFirst() && (mode === "practice" || mode === "ranked");
    const frame = player?.frame;
    part.prompt.hidden = !isDriven || !frame || frame.step > 0 || frame.outcome !== null || link === "lost";
    if (!part.prompt.hidden) put(part["prompt-text"], promptText(isTouch));
    part.coach.hidden = !isDriven || !isCoaching || !hint || !frame || frame.step === 0;
    put(part["coach-gain"], hint?.gain ?? "");
    put(part["coach-line"], hint?.line ?? "");
  }
  part["coach-close"].addEventListener("click", () => {
    isCoaching = false;
    part.coach.hidden = true;
  });
  return {
    isFirst,
    /** Take note of a change of the player's board.
     * @param {GameState} before @param {GameState} after */
    follow(before, after) {
      const [was, is] = [before.player?.frame, after.player?.frame];
      if (!isFirst() || !is || was === is || after.mode === "watch") return;
      if (is.step > 0) localStorage.setItem(VISITED, "yes");
      const isNext = was?.episode === is.episode && is.step > was.step && !is.outcome;
      hint = (isNext && after.task?.hint(was, is, said)) || null;
      if (hint?.id) said.add(hint.id);
      if (!is.outcome || was?.episode !== is.episode) return;
      body.dataset.visit = "again";
      onEnded();
    },
    paint,
  };
}
