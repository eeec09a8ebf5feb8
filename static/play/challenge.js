// A challenge: the terrain of a finished episode once more, beside what was done on it. It is practice, and never counts.

/** @param {string} hash @returns the episode that an address challenges to, or null */
export const challengedIn = (hash) => /^#challenge=([\w-]{4,64})$/.exec(hash)?.[1] ?? null;

/** @param {string} episode @returns the end of the address that challenges to it */
export const challengeHash = (episode) => `#challenge=${encodeURIComponent(episode)}`;

/** Return what is to be beaten on a board: the course of the episode that it challenges; null on any other board.
 * @param {Api} api @param {About} about @returns {Promise<Opponent | null>} */
export async function opponentOf(api, { challenges, frame }) {
  if (!challenges) return null;
  const { run } = await api.replay(challenges);
  return { episode: frame.episode, course: run.name === "You" ? { ...run, name: "Your replay" } : run };
}
