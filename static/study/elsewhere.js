// Going on on another device: the dialog with the link, its QR code and the recovery code, and the dialog that takes such a code.
import { all, by, copyOnClick, createSvg, put } from "../common/page.js";
import { t } from "../common/texts.js";
import { announce } from "./actions.js";
import { askForCode } from "./code_dialog.js";
import { study } from "./store.js";
import * as words from "./words.js";

let link = "";

/** Make a link to here for another device, and show it. */
async function showLink() {
  put(by("elsewhere-status"), t("elsewhere.moment", "One moment."));
  by("elsewhere-link").hidden = true;
  try {
    const ticket = await study.elsewhere(location.origin + location.pathname);
    link = ticket.link;
    put(by("elsewhere-address"), link);
    by("elsewhere-qr").replaceChildren(picture(ticket.qr));
    by("elsewhere-link").hidden = false;
    put(by("elsewhere-status"), words.linkHolds(ticket.until_ms));
  } catch (error) {
    put(by("elsewhere-status"), words.sentence(/** @type {Error} */ (error).message));
  }
}
/** @param {string[]} rows @returns a QR code, with the quiet margin that readers need */
function picture(rows) {
  const size = rows.length + 8;
  const path = rows.flatMap((row, y) => [...row].map((module, x) => (module === "1" ? `M${x + 4} ${y + 4}h1v1h-1z` : ""))).join("");
  return createSvg("svg", { viewBox: `0 0 ${size} ${size}`, role: "img", "aria-label": t("elsewhere.qr", "QR code of the link") },
    createSvg("rect", { width: size, height: size, fill: "#fff" }), createSvg("path", { d: path, fill: "#000" }));
}

for (const opener of [by("open-elsewhere"), ...all("[data-open=elsewhere]")]) opener.addEventListener("click", showLink);
copyOnClick(by("copy-link"), () => link, announce);
askForCode("recover", async (code) => {
  await study.goOn({ code });
  location.reload(); // as whoever has the place now
});

/** Show the recovery code, and hide what leads elsewhere from whoever cannot go there.
 * @param {Study.Participant} participant */
export function paintElsewhere({ recovery_code }) {
  for (const place of all("[data-recovery-code]")) put(place, recovery_code ?? "");
  for (const part of all("[data-elsewhere]")) part.hidden = recovery_code === null;
}
