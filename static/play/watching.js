// @ts-check
// Links of the form `#watch=ID` to somebody else's board or episode: they lead to its live view.

/** Leave the playground for the live view of a board; ApiError 404 where there is none to watch, and nothing is left
 * then.
 * @param {string} id @param {(id: string) => Promise<unknown>} load asks the server for it
 * @param {{replace: (url: string) => void}} place the address of the page */
export async function showInstead(id, load, place) {
  await load(id);
  place.replace(`watch/${encodeURIComponent(id)}`);
}
