// @ts-check
// The end card's link to the replay of the episode: to open, and to give away.
import { put } from "../common/page.js";

const SAID_MS = 2000;

/** Let the button copy the address of the link next to it.
 * @param {Record<string, HTMLElement>} part of the end card
 * @param {{clipboard: Clipboard | undefined, announce: (text: string) => void, ask: (text: string,
 *   link: string) => unknown}} how clipboard is missing on a page that came without TLS: the link is shown to be copied
 *   by hand then (`ask`) */
export function startReplayLink(part, { clipboard, announce, ask }) {
  const link = /** @type {HTMLAnchorElement} */ (part["replay-link"]);
  const button = part["copy-replay"];
  button.addEventListener("click", async () => {
    const isCopied = await clipboard?.writeText(link.href).then(() => true, () => false);
    if (!isCopied) return void ask("Copy this link:", link.href);
    put(button, "Link copied");
    announce("Link copied");
    setTimeout(() => put(button, "Copy link"), SAID_MS);
  });
}
