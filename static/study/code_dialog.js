// A dialog that asks for a code: it sends the code, shows why one is refused, and forgets it when it closes.
import { by, put } from "../common/page.js";
import { sentence } from "./words.js";

/** @param {string} id of the dialog @param {(code: string) => Promise<void>} send rejects with the reason of a refusal */
export function askForCode(id, send) {
  const status = by(`${id}-status`);
  const code = by(`${id}-code`, HTMLInputElement);
  by(`${id}-form`).addEventListener("submit", async (event) => {
    event.preventDefault();
    put(status, "");
    try {
      await send(code.value);
    } catch (error) {
      put(status, sentence(/** @type {Error} */ (error).message));
      code.select();
    }
  });
  by(id).addEventListener("close", () => {
    code.value = "";
    put(status, "");
  });
}
