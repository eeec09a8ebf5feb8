// How many people have played the paper's own study, wherever a page has a place for it: an element with `data-people`.
import { many } from "./words.js";
import { request } from "./api.js";
import { all, create } from "./page.js";

/** @typedef {{study: string, status: string, people: number, of: number, link: string}} PaperStudy */

/** @param {PaperStudy} found @returns {[string, string]} the sentence, and the words of its link */
export function peopleLine({ status, people, of }) {
  const count = `How well people explore: ${people} of ${many(of, "person", "people")} played the paper\u2019s study.`;
  /** @type {Record<string, string>} */
  const words = { open: "Take part", invited: "How to take part", closed: "Its terrains and figure" };
  return [count, words[status] ?? "What a study is"];
}

/** Fill every place for it; a server that does not answer leaves them empty. */
export async function showPeople() {
  const places = all("[data-people]");
  const found = places.length ? /** @type {PaperStudy | null} */ (await request("paper-study").catch(() => null)) : null;
  if (!found) return;
  const [line, link] = peopleLine(found);
  for (const place of places) place.replaceChildren(`${line} `, create("a", link, { href: found.link }));
}
