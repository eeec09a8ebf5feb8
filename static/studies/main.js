// The page /study: lists the studies that anybody may join.
import { request } from "../common/api.js";
import { create, by } from "../common/page.js";
import { joinable, lengthLine } from "./words.js";


async function load() {
  try {
    /** @type {Answers.ListedStudy[]} */
    const listed = await request("studies");
    const open = joinable(listed);
    by("studies").replaceChildren(...open.map((study) => create("li", [
      create("div", [create("b", study.title), create("div", lengthLine(study), { class: "fine" })]),
      create("a", "Take part", { href: `study/${encodeURIComponent(study.name)}`, "aria-label": `Take part in ${study.title}` }),
    ])));
    by("studies").hidden = open.length === 0;
    by("none").hidden = open.length > 0;
    by("none").textContent = "No study on this server is open for everybody at the moment.";
  } catch (error) {
    by("none").textContent = `The list could not be loaded: ${/** @type {Error} */ (error).message}`;
  }
}
load();
