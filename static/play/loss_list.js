// @ts-check
// The list of the moves that cost most, on the end card: each can be pointed at, pinned, and tried again.
import { create } from "../common/page.js";
import { sentenceOf, summaryOf } from "../common/loss_words.js";

/** Fill a place with the list.
 * @param {HTMLElement} place @param {Analysis} analysis
 * @param {{onPoint: (index: number | null) => void, onPin: (index: number) => void,
 *   onTry: (loss: CostlyMove) => void}} how onPoint: null when the pointer or the focus has left */
export function paintLossList(place, analysis, { onPoint, onPin, onTry }) {
  const list = create("ol", analysis.losses.map((loss, index) => {
    const show = create("button", [create("b", String(index + 1), { "aria-hidden": "true" }), create("span", sentenceOf(loss))],
      { type: "button", class: "loss", "aria-pressed": "false", "data-testid": `loss-${index + 1}` });
    const again = create("button", "Try from here", { type: "button", class: "quiet", "aria-label": `Try from here: move ${loss.step + 1}` });
    const item = create("li", [show, again]);
    show.addEventListener("click", () => onPin(index));
    again.addEventListener("click", () => onTry(loss));
    item.addEventListener("pointerenter", (event) => { if (event.pointerType === "mouse") onPoint(index); });
    item.addEventListener("pointerleave", (event) => { if (event.pointerType === "mouse") onPoint(null); });
    item.addEventListener("focusin", () => { if (show.matches(":focus-visible") || again.matches(":focus-visible")) onPoint(index); });
    item.addEventListener("focusout", () => onPoint(null));
    return item;
  }));
  const hint = analysis.losses.length ? [create("p", "Choose one to see the board as you saw it: your move is the dashed arrow, the better one is green, and green cells are what it would soon have shown.", { class: "hint" })] : [];
  place.replaceChildren(create("p", summaryOf(analysis), { role: "status" }), list, ...hint);
}

/** Show which of the list is chosen, and which is pinned.
 * @param {HTMLElement} place @param {number | null} chosen @param {number | null} pinned */
export function markChosen(place, chosen, pinned) {
  place.querySelectorAll("li").forEach((item, index) => {
    item.classList.toggle("is-chosen", index === chosen);
    item.querySelector(".loss")?.setAttribute("aria-pressed", String(index === pinned));
  });
}

/** Show that the moves are being judged.
 * @param {HTMLElement} place @param {number} cells of the board */
export function paintWorking(place, cells) {
  const time = cells > 600 ? "On a board of this size that can take a minute." : "That takes a few seconds.";
  place.replaceChildren(create("p", `Trying every other way you could have gone. ${time}`, { role: "status" }), create("progress", [], { "aria-label": "Judging your moves" }));
}

/** Show why there is no list.
 * @param {HTMLElement} place @param {string} reason */
export function paintFailure(place, reason) {
  place.replaceChildren(create("p", `${reason.slice(0, 1).toUpperCase()}${reason.slice(1)}.`.replace(/\.\.$/, "."), { role: "status" }));
}
