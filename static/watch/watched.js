// @ts-check
// A watched board in words, and as the page's state has it. No document here, so that node can test it.

/** Return what the address of the page names, if anything: a board by its id for watching, or an episode.
 * @param {string} pathname */
export const idInPath = (pathname) => /\/watch\/([\w-]{4,64})$/.exec(pathname)?.[1] ?? null;

/** Return the name of a watched board.
 * @param {string} player */
export const watchedName = (player) => ({ human: "Somebody", script: "A script" })[player] ?? player;

/** Return the headline of the page while the episode runs.
 * @param {string} player */
export const liveHeadline = (player) => `Live: ${({ human: "somebody else", script: "a script" })[player] ?? player} is exploring`;

/** Return the board of a watched episode as it stands.
 * @param {Watched} watched @returns {Board} */
export function watchedBoard({ episode, player, frame, history }) {
  return { session: episode, name: watchedName(player), frame, trail: history.positions, discovered: history.discovered, hasGap: false, pace: null, isReplay: false };
}
