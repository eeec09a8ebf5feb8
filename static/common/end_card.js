// The card at the end of an episode: its lines, buttons and links stand in end_card.html, and a page says which of them it shows.
import { by, copied, copyOnClick, create, partsOf, put } from "./page.js";

/** What a page has for the card's parts: sentences, numbers by their names, the text to share, addresses of links, and which
 * buttons there are.
 * @typedef {{title?: string, line?: string, figures?: [string, string][], compare?: string, own?: string,
 *   note?: string, share?: string, next?: string, again?: boolean, practise?: boolean, copy?: boolean, replay?: string,
 *   beat?: string, watch?: string, play?: string, episodes?: string}} Content */

/** @param {HTMLElement} link @param {string} href */
const lead = (link, href) => link.setAttribute("href", href);
const asItStands = () => {};

/** How a part is filled. One for which a page has nothing is hidden.
 * @type {{[Name in keyof Content]-?: (part: HTMLElement, filling: NonNullable<Content[Name]>) => void}} */
const FILLS = {
  title: put, line: put, compare: put, own: put, note: put,
  figures: (list, figures) => list.replaceChildren(...figures.map(([name, value]) => create("div", [create("dt", name), create("dd", value)]))),
  share: (place, text) => { /** @type {HTMLTextAreaElement} */ (place.querySelector("textarea")).value = text; },
  next: (button, text) => put(/** @type {HTMLElement} */ (button.querySelector("span")), text),
  again: asItStands, practise: asItStands, copy: asItStands,
  replay: lead, beat: lead, watch: lead, play: lead, episodes: lead,
};

const NAMES = /** @type {(keyof Content)[]} */ (Object.keys(FILLS));

/** @template {keyof Content} Name @param {HTMLElement} part @param {Name} name @param {Content[Name]} filling */
function fillPart(part, name, filling) {
  part.hidden = !filling;
  if (!part.hidden) /** @type {(part: HTMLElement, filling: unknown) => void} */ (FILLS[name])(part, filling);
}

/** Find the page's card. What moves cost, and the question for it, belong to the task. */
export function startEndCard() {
  const root = by("end");
  const part = partsOf(root);
  startCopying(part);
  return {
    part,
    /** Fill the card once the episode on the board has ended, hide it before; return whether it has just come up.
     * @param {Frame | null | undefined} frame @param {Content} content */
    show(frame, content) {
      const wasHidden = root.hidden;
      root.hidden = !frame?.outcome;
      if (root.hidden) return false;
      for (const name of NAMES) fillPart(part[name], name, content[name]);
      return wasHidden;
    },
  };
}

/** Let the text to share and the link to the replay be copied.
 * @param {Record<string, HTMLElement>} part */
function startCopying(part) {
  copyOnClick(part.copy, () => /** @type {HTMLAnchorElement} */ (part.replay).href, (text) => put(by("announcer"), text));
  const text = by("share-text", HTMLTextAreaElement);
  part["copy-text"].addEventListener("click", async () => {
    text.select();
    put(part["copy-text"], (await copied(text.value)) || document.execCommand("copy") ? "Copied" : "Press Ctrl+C");
    setTimeout(() => put(part["copy-text"], "Copy"), 2500);
  });
}
