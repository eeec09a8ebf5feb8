// @ts-check
// The page's dialogs: what opens them, what closes them, and the map in words.
import { create, elementsOf, put } from "../common/page.js";
import { sentence, supervisedLine } from "./words.js";

/** @param {Document} page @param {{game: () => GameState, onClose: () => void}} how */
export function startDialogs(page, { game, onClose }) {
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
    const { player, task } = game();
    if (!player || !task) return;
    const { line, rows } = task.inWords(player.frame, "the terrain");
    by("map-here").textContent = line;
    by("map-rows").replaceChildren(...rows.map((text) => create("li", text)));
  }
  return { isOpen: () => Boolean(page.querySelector("dialog[open]")) };
}

/**
 *   supervise   sends what was typed
 * @param {Document} page
 * @param {{supervise: (code: string) => Promise<Study.Participant>, dispatch: (event: Study.Event) => void}} how */
export function startSupervision(page, { supervise, dispatch }) {
  const by = elementsOf(page);
  const code = by("code-typed", HTMLInputElement);
  const dialog = by("supervise", HTMLDialogElement);

  by("supervise-form").addEventListener("submit", async (event) => {
    event.preventDefault();
    put(by("supervise-status"), "");
    try {
      const participant = await supervise(code.value);
      dispatch({ kind: "participant", participant });
      dialog.close();
    } catch (error) {
      put(by("supervise-status"), sentence(/** @type {Error} */ (error).message));
      code.select();
    }
  });
  dialog.addEventListener("close", () => {
    code.value = "";
    put(by("supervise-status"), "");
  });
  return {
    /** @param {Study.Participant} participant */
    paint(participant) {
      for (const line of /** @type {NodeListOf<HTMLElement>} */ (page.querySelectorAll("[data-supervised]"))) put(line, supervisedLine(participant.supervised_until_ms, Date.now()));
    },
  };
}
