// What every page does with its elements: finds them by id, makes them, and changes only what is new.
import { t } from "./texts.js";

/** Return the element of an id; TypeError where the page has none of that id and kind.
 * @template {Element} [T=HTMLElement] @param {string} id
 * @param {new () => T} [kind] the element's class, HTMLElement unless more is needed @returns {T} */
export function by(id, kind = /** @type {new () => T} */ (/** @type {unknown} */ (HTMLElement))) {
  const found = document.getElementById(id);
  if (!(found instanceof kind)) throw new TypeError(`expected #${id} to be a ${kind.name}, found ${found}`);
  return found;
}

/** @param {string} selector @param {ParentNode} [root] @returns what it finds there, in the page's order */
export const all = (selector, root = document) => /** @type {HTMLElement[]} */ ([...root.querySelectorAll(selector)]);

/** Return a new element.
 * @template {keyof HTMLElementTagNameMap} K @param {K} kind @param {string | Node | (string | Node)[]} [content]
 * @param {Record<string, string>} [attributes] @returns {HTMLElementTagNameMap[K]} */
export function create(kind, content = [], attributes = {}) {
  const element = document.createElement(kind);
  element.append(...(Array.isArray(content) ? content : [content]));
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  return element;
}

/** Return a new element of a picture.
 * @param {string} kind @param {Record<string, string | number>} attributes @param {(string | Node)[]} content */
export function createSvg(kind, attributes, ...content) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", kind);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
  element.append(...content);
  return element;
}

/** Set an element's text, if it is another one.
 * @param {HTMLElement} element @param {string} text */
export function put(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** @param {string} text @returns whether it is on the clipboard; a page without TLS has none */
export const copied = async (text) => Boolean(await navigator.clipboard?.writeText(text).then(() => true, () => false));

/** Let a button copy a link, or a text with one; where there is no clipboard it shows it to be copied by hand.
 * @param {HTMLElement} button @param {() => string} link @param {(text: string) => void} announce to screen readers
 * @param {{done: string, byHand: string}} says the button when it is copied, and what asks to copy it by hand */
export function copyOnClick(button, link, announce, { done, byHand } = { done: t("copy.done", "Link copied"), byHand: t("copy.by_hand", "Copy this link:") }) {
  button.addEventListener("click", async () => {
    if (!(await copied(link()))) return void window.prompt(byHand, link());
    const name = button.textContent ?? "";
    if (name === done) return;
    put(button, done);
    announce(done);
    setTimeout(() => put(button, name), 2000);
  });
}

/** Show sentences that can be dismissed.
 * @param {HTMLElement} root @param {GameState["notices"]} notices @param {(id: number) => void} dismiss */
export function paintNotices(root, notices, dismiss) {
  root.replaceChildren(...notices.map(({ id, text, tone }) => {
    const button = create("button", t("notice.dismiss", "Dismiss"), { type: "button", class: "quiet" });
    button.onclick = () => dismiss(id);
    return create("p", [text, button], { "data-tone": tone });
  }));
}

/** Show the health of the connection in the top bar.
 * @param {HTMLElement} root @param {"connecting" | "open" | "lost"} link
 * @param {string} whenOpen what stands there while all is well */
export function paintLink(root, link, whenOpen) {
  root.dataset.link = link;
  const words = /** @type {HTMLElement} */ (root.lastElementChild);
  if (link !== "lost") put(words, { connecting: t("bar.connecting", "connecting"), open: whenOpen }[link]);
  else if (!words.firstElementChild) words.replaceChildren(t("bar.lost", "connection lost"), create("span", t("bar.trying", ", trying again"), { class: "long" })); // wide screens alone have room
}

/** Schedule one repaint for the next frame, however often it is asked for.
 * @param {(isWhole: boolean) => void} paint isWhole: also what did not change, because sizes or colours did */
export function createRepaint(paint) {
  let isScheduled = false;
  let isWhole = false;
  function repaint(isAll = false) {
    isWhole ||= isAll;
    if (isScheduled) return;
    isScheduled = true;
    requestAnimationFrame(() => {
      const wasWhole = isWhole;
      isScheduled = isWhole = false;
      paint(wasWhole);
    });
  }
  addEventListener("contextrestored", () => repaint(true), true); // a browser that lost its graphics process gives back empty canvases
  return repaint;
}

/** How long a curve waits where time runs: it is painted four times a second. */
export const SLOW_MS = 250;

/** Return what calls a function later, with its last arguments, however often it is called meanwhile.
 * @template {unknown[]} T @param {(...given: T) => void} work
 * @param {number} wait_ms 0 in an animation frame: once that frame has been painted */
export function createSlow(work, wait_ms) {
  /** @type {T | null} */
  let newest = null;
  return (/** @type {T} */ ...given) => {
    if (!newest) {
      setTimeout(() => {
        const last = /** @type {T} */ (newest);
        newest = null;
        work(...last);
      }, wait_ms);
    }
    newest = given;
  };
}

/** Return the elements of a place by their `data-part`.
 * @param {ParentNode} root @returns {Record<string, HTMLElement>} */
export const partsOf = (root) => Object.fromEntries(all("[data-part]", root).map((each) => [each.dataset.part, each]));

/** Return the room of elements in CSS pixels, without asking for a layout at each repaint.
 * @param {() => void} onChange another size */
export function createSizes(onChange) {
  /** @type {WeakMap<Element, {width_px: number, height_px: number}>} */
  const sizes = new WeakMap();
  const observer = new ResizeObserver((entries) => {
    for (const { target, contentRect: { width, height } } of entries) sizes.set(target, { width_px: width, height_px: height });
    onChange();
  });
  return {
    /** @param {HTMLElement} element */
    watch: (element) => observer.observe(element),
    /** @param {HTMLElement} element */
    of: (element) => sizes.get(element) ?? { width_px: element.clientWidth, height_px: element.clientHeight },
  };
}

/** @param {Element} element @returns what reads its custom properties */
export function reader(element) {
  const style = getComputedStyle(element);
  return (/** @type {string} */ name) => style.getPropertyValue(name).trim();
}

/** Return the colours of a board: of the player, of the policy, of a better move, and of what is drawn round things.
 * They are the same in every theme.
 * @param {Element} element the board's canvas, or anything around it */
export function boardColours(element) {
  const read = reader(element);
  return { you: read("--board-you"), policy: read("--board-policy"), better: read("--board-better"), casing: read("--board-casing"), alarm: read("--board-alarm") };
}

/** Return the colours of a chart, which follow the theme of the page, and the face of its numbers.
 * @param {Element} element the chart's canvas, or anything around it
 * @returns {{inks: Inks, you: string, policy: string, ground: string, font: string}} */
export function chartColours(element) {
  const read = reader(element);
  const inks = { text: read("--chart-text"), goal: read("--chart-goal"), base: read("--chart-base"), line: read("--chart-line") };
  return { inks, you: read("--chart-you"), policy: read("--chart-policy"), ground: read("--panel"), font: read("--figures") };
}
