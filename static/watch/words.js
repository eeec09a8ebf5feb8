// A watched board in words. No document here, so that node can test it.

/** Return what the address of the page names, if anything: a board by its id for watching, or an episode.
 * @param {string} pathname */
export const idInPath = (pathname) => /\/watch\/([\w-]{4,64})$/.exec(pathname)?.[1] ?? null;

/** @param {string} player @returns the name of a watched board, of a policy the technical one */
export const watchedName = (player) => ({ you: "You", human: "Somebody", script: "A script" })[player] ?? player;

/** @param {string} player a policy by its plain name @returns the headline of the page while the episode runs */
export const liveHeadline = (player) => (player === "you" ? "Live: you are playing" : `Live: ${({ human: "somebody else", script: "a script" })[player] ?? player} is playing`);
/** Return the line below the headline of an ended episode without a replay.
 * @param {string} player @param {string} round what the task calls an episode @param {boolean} goesOn the board's next one is shown too */
export const endedLine = (player, round, goesOn) => (goesOn ? `The next ${round} on this board is shown here as soon as it begins.` : player === "you" ? "Its replay opens once the day is over." : "");
