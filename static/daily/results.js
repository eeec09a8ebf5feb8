// @ts-check
// What the daily terrain came to: the end card, the distribution, the policies, and yesterday.
import { paintDistribution } from "../common/distribution.js";
import { create, elementsOf, put } from "../common/page.js";
import { resultText, dayText, peopleText, policyText, rankText, shareText } from "./words.js";

/** How often policies that are still exploring are asked for. */
const ASK_AGAIN_MS = 2000;

/** Return a row of a table of results: who, and what they came to.
 * @param {string} who @param {string} what @param {"you" | "person" | "policy"} kind
 * @param {string} [episode] whose replay the row leads to */
function row(who, what, kind, episode) {
  const name = episode ? create("a", who, { href: `replay/${encodeURIComponent(episode)}` }) : create("span", who);
  return create("li", [name, create("b", what)], { class: kind });
}

/** @param {Daily.PolicyResult[]} policies */
const policyRows = (policies) => policies.map((policy) => row(policy.name, policyText(policy), "policy"));

/** @param {Document} page
 * @param {{task: Task, load: (day: string) => Promise<Daily.Results>, onWrong: (text: string) => void}} how */
export function createResults(page, { task, load, onWrong }) {
  const by = elementsOf(page);
  const area = by("share-text", HTMLTextAreaElement);
  by("copy").addEventListener("click", async () => {
    area.select();
    try {
      await navigator.clipboard.writeText(area.value);
      put(by("copy"), "Copied");
    } catch {
      put(by("copy"), page.execCommand("copy") ? "Copied" : "Press Ctrl+C"); // a page without TLS may not write to the clipboard
    }
    setTimeout(() => put(by("copy"), "Copy"), 2500);
  });

  /** @param {Daily.Results} results */
  function paint({ day, attempt, people, policies }) {
    if (!attempt) return;
    put(by("end-title"), resultText(task, attempt).replace(/^./, (first) => first.toUpperCase()));
    put(by("end-rank"), rankText(attempt, people, policies));
    area.value = shareText(task, day, attempt, policies, new URL("daily", page.baseURI).href);
    by("replay").setAttribute("href", `replay/${encodeURIComponent(attempt.episode)}`);
    const marks = policies.flatMap(({ name, moves }) => (moves === null ? [] : [{ name, moves }]));
    paintDistribution(by("distribution"), { target: task.target, counts: people.moves, you: attempt.outcome === "explored" ? attempt.moves : null, marks });
    put(by("people-note"), peopleText(task, people));
    by("policies").replaceChildren(...policyRows(policies));
    by("end").hidden = by("results").hidden = false;
  }
  return {
    /** Show what a player's attempt came to, and the policies as soon as they are ready.
     * @param {string} day */
    async show(day) {
      try {
        const found = await load(day);
        paint(found);
        if (found.policies.some(({ state }) => state === "waiting" || state === "computing")) setTimeout(() => this.show(day), ASK_AGAIN_MS);
      } catch (error) {
        onWrong(/** @type {Error} */ (error).message);
      }
    },
    /** Show the results of the day before.
     * @param {{day: string, commitment: string, key: string | null}} yesterday */
    async showYesterday({ day, commitment, key }) {
      put(by("key"), key ?? "");
      put(by("key-commitment"), commitment);
      by("key-link").setAttribute("href", `api/daily/${day}`);
      by("key").hidden = by("key-commitment").hidden = by("key-line").hidden = false;
      const { people, policies } = await load(day);
      put(by("yesterday-title"), `Yesterday, ${dayText(day)}`);
      const best = people.table.slice(0, 5).map((each) => row(`${each.rank}. ${each.you ? "You" : "A person"}`, resultText(task, { ...each, moves: each.moves ?? 0 }).replace(" after 0 moves", ""), each.you ? "you" : "person", each.episode));
      by("yesterday-rows").replaceChildren(...best, ...policyRows(policies.filter(({ moves }) => moves !== null)));
      put(by("yesterday-note"), peopleText(task, people));
      by("yesterday").hidden = false;
    },
  };
}
