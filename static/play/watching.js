// @ts-check
// Links of the form `#watch=EPISODE` to somebody else's episode: they lead to its live view, which leads to its replay.

/**
 * Leave the playground for the live view of an episode; ApiError 404 where there is none to watch, and nothing is left then.
 * @param {string} episode
 * @param {(episode: string) => Promise<unknown>} load asks the server for it
 * @param {{replace: (url: string) => void}} place the address of the page
 */
export async function showInstead(episode, load, place) {
  await load(episode);
  place.replace(`watch/${encodeURIComponent(episode)}`);
}
