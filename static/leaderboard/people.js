// The people who chose a name, by how many moves more than Expert they need.
import { create } from "../common/page.js";
import { signed } from "../common/words.js";

/** Fill the table, and the line about the player's own name.
 * @param {HTMLTableElement} table @param {HTMLElement} own @param {Answers.People} found */
export function paintPeople(table, own, { people, you }) {
  const rows = people.map(({ name, gap, episodes, you: isYou }, index) => {
    const label = create("th", [name, ...(isYou ? [create("small", "you")] : [])], { scope: "row" });
    const cells = [
      create("td", String(index + 1), { class: "number place" }),
      label,
      create("td", signed(gap), { class: "number" }),
      create("td", String(episodes), { class: "number wide" }),
    ];
    return create("tr", cells, isYou ? { "aria-current": "true" } : {});
  });
  const nobody = "Nobody with a name has five ranked terrains yet. Play ranked, choose a name, and you are the first.";
  const empty = create("tr", [create("td", nobody, { class: "empty", colspan: "4" })]);
  table.tBodies[0].replaceChildren(...(rows.length ? rows : [empty]));
  const choose = create("a", "Choose a name to stand here", { href: "me#name" });
  own.replaceChildren(...(you?.name ? [] : [choose]));
}
