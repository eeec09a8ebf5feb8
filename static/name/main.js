// Asks whoever comes for a name, once, before the first episode.
import { request } from "../common/api.js";
import { by, put } from "../common/page.js";

by("name-form", HTMLFormElement).addEventListener("submit", async (event) => {
  event.preventDefault();
  const { value } = by("name", HTMLInputElement);
  try {
    await request("me/name", { name: value }, undefined, { method: "PUT" });
    location.reload();
  } catch (error) {
    put(by("name-note"), /** @type {Error} */ (error).message);
    by("name").focus();
  }
});
