// @ts-check
// The end card's question after a practice episode: where did I lose moves? Each answer can be tried again from that move.
import { ApiError } from "../common/api.js";
import { paintLosses } from "../common/losses.js";
import { create } from "../common/page.js";

/** @typedef {import("../common/game_state.js").State} State */

/**
 *   load      the regret of a finished episode
 *   tryFrom   begins the same terrain and makes the first moves of the episode once more
 * @param {Record<string, HTMLElement>} part of the player's panel
 * @param {{state: () => State, load: (episode: string) => Promise<import("../common/losses.js").Regret>,
 *   tryFrom: (session: string, episode: string, step: number) => Promise<void>}} how
 */
export function createLosses(part, { state, load, tryFrom }) {
  /** @type {string | null} the episode whose losses are shown or asked for */
  let shown = null;

  async function ask() {
    const player = state().player;
    if (!player) return;
    const { session } = player;
    const { episode } = player.frame;
    shown = episode;
    part.ask.hidden = true;
    part.losses.hidden = false;
    part.losses.replaceChildren(create("p", "Trying every other move; this takes some seconds\u2026"));
    try {
      const regret = await load(episode);
      if (shown !== episode) return;
      paintLosses(part.losses, regret, { label: "Try from here", onChoose: ({ step }) => tryFrom(session, episode, step) });
    } catch (error) {
      if (shown !== episode) return;
      part.losses.replaceChildren(create("p", error instanceof ApiError ? error.message : `Something went wrong on this page: ${error}`));
    }
  }
  part.ask.addEventListener("click", ask);
  return {
    /** Show the question where a practice episode has ended, and nothing of another episode. */
    paint() {
      const { mode, player } = state();
      const episode = player?.frame.outcome && mode === "practice" ? player.frame.episode : null;
      if (shown !== null && shown === episode) return;
      shown = null;
      part.ask.hidden = episode === null || player?.frame.step === 0;
      part.losses.hidden = true;
    },
  };
}
