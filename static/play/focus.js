// The keys belong to the board again after each click and after each dialog. Who works with Tab keeps the focus where it is.

/** What a click leaves focused without a need for it. */
const CONTROLS = "button, summary, label, input[type=checkbox], [role=tab]";

/** Return whether a click on a control may give the focus back: it was made by a pointer, outside of dialogs and of
 * what is typed in.
 * @param {{detail: number}} event @param {{closest: (selector: string) => unknown} | null} target */
export const givesBack = (event, target) => event.detail > 0 && Boolean(target?.closest(CONTROLS)) && !target?.closest("dialog, [data-keeps-focus]");

/** Keep the focus on the board.
 *   next   what Enter means once the episode is over, or null while it runs
 * @param {{board: HTMLElement, next: () => HTMLElement | null}} how */
export function keepFocusOnBoard({ board, next }) {
  board.tabIndex = -1;
  /** @type {EventTarget | null} the choice that a pointer opened */
  let opened = null;
  function giveBack() {
    if (!document.querySelector("dialog[open]")) (next() ?? board).focus({ preventScroll: true });
  }
  const soon = () => setTimeout(giveBack); // once the browser has put the focus where it wants it, and other listeners have run
  document.addEventListener("click", (event) => { if (givesBack(event, /** @type {Element | null} */ (event.target))) soon(); });
  document.addEventListener("close", soon, true);
  document.addEventListener("pointerdown", (event) => { opened = /** @type {Element} */ (event.target).closest("select"); }, true);
  document.addEventListener("keydown", (event) => { if (event.key === "Tab") opened = null; }, true);
  document.addEventListener("change", (event) => { if (event.target === opened) closed(); });
  document.addEventListener("keyup", (event) => { if ((event.key === "Escape" || event.key === "Enter") && event.target === opened) closed(); });
  // who chooses what was chosen before changes nothing, and no event says that the list is closed
  if (CSS.supports("selector(select:open)")) {
    document.addEventListener("pointermove", (event) => {
      if (event.pointerType === "mouse" && opened instanceof Element && !opened.matches(":open")) closed();
    });
  }

  function closed() {
    if (!(opened instanceof Element) || opened.closest("dialog")) return;
    opened = null;
    soon();
  }
}
