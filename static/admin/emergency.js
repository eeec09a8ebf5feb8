// @ts-check
// A look at a hidden figure outside the plan: a reason is asked for, the server logs it, and the figure stays until the page is left.
import { elementsOf } from "../common/page.js";

/** @typedef {import("./words.js").Study} Study */
/** @typedef {import("./words.js").Figure} Figure */

/**
 * @param {Document} page
 * @param {{look: (reason: string) => Promise<{figure: Figure}>, onShown: () => void}} how
 */
export function createEmergency(page, { look, onShown }) {
  const by = elementsOf(page);
  const dialog = by("emergency", HTMLDialogElement);
  const reason = by("emergency-reason", HTMLTextAreaElement);
  /** @type {{name: string, figure: Figure} | null} */
  let seen = null;
  let name = "";

  by("open-emergency").addEventListener("click", () => {
    reason.value = by("emergency-wrong").textContent = "";
    dialog.showModal();
  });
  by("emergency-cancel").addEventListener("click", () => dialog.close());
  by("emergency-form").addEventListener("submit", async (event) => {
    event.preventDefault();
    const asked = name;
    try {
      seen = { name: asked, figure: (await look(reason.value)).figure };
      dialog.close();
      onShown();
    } catch (error) {
      by("emergency-wrong").textContent = /** @type {Error} */ (error).message;
    }
  });
  return {
    /**
     * Return the study with the figure of an emergency look in the place of the one that is hidden.
     * @param {Study} study
     * @returns {Study}
     */
    withFigure(study) {
      name = study.name;
      by("emergency-part").hidden = study.status !== "open" || !study.hides_interim;
      return seen?.name === study.name ? { ...study, figure: seen.figure } : study;
    },
  };
}
