// @ts-check
// The page's dialogs: what opens them, what closes them, and the map in words.
import { create, elementsOf } from "../common/page.js";
import { describeBoard } from "../common/words.js";
import { mapInWords } from "./words.js";

/** @param {Document} page @param {{frame: () => Frame | undefined, onClose: () => void}} how */
export function startDialogs(page, { frame, onClose }) {
  const by = elementsOf(page);
  for (const dialog of page.querySelectorAll("dialog")) {
    for (const opener of [by(`open-${dialog.id}`), ...page.querySelectorAll(`[data-open=${dialog.id}]`)]) {
      opener.addEventListener("click", () => {
        if (dialog.id === "map") fillMap();
        dialog.showModal();
      });
    }
    dialog.addEventListener("click", (event) => {
      if (event.target === dialog || /** @type {Element} */ (event.target).closest("[data-close]")) dialog.close();
    });
    dialog.addEventListener("close", onClose);
  }
  by("disagree").addEventListener("click", () => by("leave", HTMLDialogElement).showModal());

  function fillMap() {
    const on = frame();
    if (!on) return;
    by("map-here").textContent = describeBoard(on, "the terrain");
    by("map-rows").replaceChildren(...mapInWords(on).map((text) => create("li", text)));
  }
  return { isOpen: () => Boolean(page.querySelector("dialog[open]")) };
}
