// Going on on another device: the dialog with the link, its QR code and the recovery code, and the dialog that takes such a code.
import { all, by, copyOnClick, createSvg, put } from "../common/page.js";
import { announce } from "./actions.js";
import { qrCode } from "./qr.js";
import { study } from "./store.js";
import * as words from "./words.js";

const recover = by("recover", HTMLDialogElement);
const typed = by("recovery-typed", HTMLInputElement);
let link = "";

/** Make a link to here for another device, and show it. */
async function showLink() {
  put(by("elsewhere-status"), "One moment.");
  by("elsewhere-link").hidden = true;
  try {
    const { token, until_ms } = await study.elsewhere();
    const address = new URL(location.href);
    address.search = "";
    address.hash = `go=${token}`;
    link = address.href;
    put(by("elsewhere-address"), link);
    by("elsewhere-qr").replaceChildren(...picture(link));
    by("elsewhere-link").hidden = false;
    put(by("elsewhere-status"), words.linkHolds(until_ms));
  } catch (error) {
    put(by("elsewhere-status"), words.sentence(/** @type {Error} */ (error).message));
  }
}
/** @param {string} text @returns {Node[]} its QR code, with the quiet margin that readers need */
function picture(text) {
  const rows = qrCode(text);
  if (!rows) return [];
  const size = rows.length + 8;
  const path = rows.flatMap((row, y) => row.map((isDark, x) => (isDark ? `M${x + 4} ${y + 4}h1v1h-1z` : ""))).join("");
  return [createSvg("svg", { viewBox: `0 0 ${size} ${size}`, role: "img", "aria-label": "QR code of the link" },
    createSvg("rect", { width: size, height: size, fill: "#fff" }), createSvg("path", { d: path, fill: "#000" }))];
}

for (const opener of [by("open-elsewhere"), ...all("[data-open=elsewhere]")]) opener.addEventListener("click", showLink);
copyOnClick(by("copy-link"), () => link, announce);
by("recover-form").addEventListener("submit", async (event) => {
  event.preventDefault();
  put(by("recover-status"), "");
  try {
    await study.goOn({ code: typed.value });
    location.reload(); // as whoever has the place now
  } catch (error) {
    put(by("recover-status"), words.sentence(/** @type {Error} */ (error).message));
    typed.select();
  }
});
recover.addEventListener("close", () => {
  typed.value = "";
  put(by("recover-status"), "");
});

/** Show the recovery code, and hide what leads elsewhere from whoever cannot go there.
 * @param {Study.Participant} participant */
export function paintElsewhere({ recovery_code }) {
  for (const place of all("[data-recovery-code]")) put(place, recovery_code ?? "");
  for (const part of all("[data-elsewhere]")) part.hidden = recovery_code === null;
}
