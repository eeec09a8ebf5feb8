// The people who chose a name, by their ratings, with the policies among them.
import { create } from "../common/page.js";
import { beatenText } from "../me/words.js";
import { policyName } from "../task/mars/names.js";

/** Fill the table, and the line about the player's own rating.
 * @param {HTMLTableElement} table @param {HTMLElement} own @param {Leaderboard.Ratings} found */
export function paintPeople(table, own, { people, policies, you }) {
  const rows = [...people.map((each) => ({ ...each, isPolicy: false })), ...policies.map(({ name, rating }) => ({ name: policyName(name), rating, games: 0, days: 0, beaten: {}, you: false, isPolicy: true }))]
    .sort((one, other) => other.rating - one.rating);
  let place = 0;
  table.tBodies[0].replaceChildren(...rows.map((each) => {
    const beaten = policies.map(({ name }) => (each.games ? `${/** @type {Record<string, number>} */ (each.beaten)[name] ?? 0} of ${each.games}` : "\u2013"));
    const counts = each.isPolicy ? ["", "", "", ""] : [String(each.games), ...beaten, String(each.days)];
    const cells = counts.map((text, index) => create("td", text, { class: `number${index === 1 ? "" : " wide"}` }));
    const name = create("th", [each.name, ...(each.isPolicy ? [create("small", "policy")] : each.you ? [create("small", "you")] : [])], { scope: "row" });
    return create("tr", [create("td", each.isPolicy ? "" : String(++place), { class: "number place" }), name, create("td", String(each.rating), { class: "number" }), ...cells], each.you ? { "aria-current": "true" } : {});
  }));
  if (!people.length) table.tBodies[0].append(create("tr", [create("td", "Nobody has chosen a name yet. Play ranked, choose one, and you are the first.", { class: "empty", colspan: "7" })]));
  own.replaceChildren(...(you?.rating ? [`${beatenText(you)} `] : ["You have no rating yet: it begins with your first ranked terrain. ", create("a", "Play", { href: "./" })]),
    ...(you?.rating && !you.name ? [create("a", "Choose a name to stand here", { href: "me#name" })] : []));
}
