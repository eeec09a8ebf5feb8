// @ts-check
// Supervised sessions: the dialog in which the operator types the code of the day, and the line that says until when it holds.
import { elementsOf, put } from "../common/page.js";
import { sentence, supervisedLine } from "./words.js";

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
