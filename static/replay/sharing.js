// Addresses of a replay: what a link holds besides the episode, and where its files are. No document here, so that node can test it.

/** @param {string} hash @returns the move in an address, null without one */
export function moveInHash(hash) {
  const found = /^#move=(\d{1,6})$/.exec(hash);
  return found ? Number(found[1]) : null;
}

/** Return the link to a replay: with the policy if another one than usual is shown, and the move if it is neither the
 * first nor the last.
 * @param {string} page the address of the page
 * @param {{ghost: string | null, preferred: string | null, step: number, last: number}} shown */
export function linkTo(page, { ghost, preferred, step, last }) {
  const url = new URL(page);
  url.search = ghost === preferred ? "" : new URLSearchParams({ ghost: ghost ?? "none" }).toString();
  url.hash = step > 0 && step < last ? `move=${step}` : "";
  return url.href;
}

/** Return the policy that an address asks for: null for none, undefined where it asks for nothing.
 * @param {string} search */
export function ghostInSearch(search) {
  const name = new URLSearchParams(search).get("ghost");
  return name === null ? undefined : name === "none" || name === "" ? null : name;
}

/** Return the address of a replay's file, relative to its page.
 * @param {string} episode @param {string} format html, gif, mp4 or png @param {string | null} ghost */
export function fileAddress(episode, format, ghost) {
  const query = format === "png" ? "" : `?${new URLSearchParams({ ghost: ghost ?? "none" })}`;
  return `${encodeURIComponent(episode)}.${format}${query}`;
}
