// A watched board in words. No document here, so that node can test it.

/** Return what the address of the page names, if anything: a board by its id for watching, or an episode.
 * @param {string} pathname */
export const idInPath = (pathname) => /\/watch\/([\w-]{4,64})$/.exec(pathname)?.[1] ?? null;

/** @param {string} player @returns the name of a watched board */
export const watchedName = (player) => ({ human: "Somebody", script: "A script" })[player] ?? player;

/** @param {string} player @returns the headline of the page while the episode runs */
export const liveHeadline = (player) => `Live: ${({ human: "somebody else", script: "a script" })[player] ?? player} is exploring`;
