// The people's board, by how many moves more than Expert they need.
import { create } from "../common/page.js";
import { many, signed } from "../common/words.js";

/** @param {Pick<Task, "round">} task @param {"week" | "all"} period @param {Answers.People} answer
 * @returns {string} what fills a table without anybody */
export function emptyText({ round }, period, { you, fewest }) {
  const missing = you ? you.missing : fewest;
  const when = period === "week" ? "in the last seven days" : "yet";
  return `Nobody has ${fewest} ranked ${round}s ${when}. Play ranked: ${many(missing, round)}${you?.terrains ? " more" : ""}, and you are the first.`;
}

/** @param {Pick<Task, "round">} task @param {"week" | "all"} period @param {Answers.OwnStanding} you
 * @returns {string} how far somebody is from a place */
export function missingText({ round }, period, { terrains, missing }) {
  const when = period === "week" ? " in the last seven days" : "";
  return `You have ${many(terrains, `ranked ${round}`)}${when}: ${missing} more, and you stand here.`;
}

/** @param {Pick<Task, "round" | "nameOf" | "expert">} task @param {number} comparing @param {boolean} hasFigures in the table
 * @returns {string} "" where the expert has played all */
export function comparingText({ round, nameOf, expert }, comparing, hasFigures) {
  if (!comparing) return "";
  return `${nameOf(expert ?? "")} plays ${many(comparing, `more ${round}`)} to compare.${hasFigures ? " The figures follow." : ""}`;
}

/** @param {Pick<Task, "round">} task @param {number} fewest @returns what fills a table while the expert plays */
export const fillingText = ({ round }, fewest) => `Play ${many(fewest, `ranked ${round}`)}, and you have a place here.`;

/** Places that are in sight with the head of the table. */
const NEAR = 8;

/** @param {string | number} place @param {string} name @param {boolean} isYou
 * @param {{behind: number, worse: number, terrains: number}} figures */
function row(place, name, isYou, { behind, worse, terrains }) {
  const label = create("th", [name, ...(isYou && name !== "You" ? [create("small", "you")] : [])], { scope: "row" });
  const numbers = [[signed(behind), "number"], [signed(worse), "number"], [String(terrains), "number wide"]];
  const cells = [create("td", String(place), { class: "number place" }), label, ...numbers.map(([text, kind]) => create("td", text, { class: kind }))];
  return create("tr", cells, isYou ? { "aria-current": "true" } : {});
}

/** Fill the table; whoever asks stands at its foot, wherever they are in it.
 * @param {HTMLTableElement} table @param {HTMLElement} own @param {Task} task @param {"week" | "all"} period
 * @param {Answers.People} answer */
export function paintPeople(table, own, task, period, answer) {
  const { people, you, comparing, ranked } = answer;
  const rows = people.map((person) => row(person.place, person.name ?? (person.you ? "You" : "Somebody"), person.you, person));
  const play = create("a", "Play ranked", { class: "go", href: "./?mode=ranked" });
  // while the expert plays, nobody can say who has how many
  const filling = comparing ? fillingText(task, answer.fewest) : emptyText(task, period, answer);
  const empty = create("tr", [create("td", [create("p", filling), create("p", [play], { class: "buttons" })], { class: "empty", colspan: "5" })]);
  table.tBodies[0].replaceChildren(...(rows.length ? rows : [empty]));
  const foot = /** @type {HTMLTableSectionElement} */ (table.tFoot);
  if (you?.place && you.place > NEAR && you.behind !== null && you.worse !== null) {
    const { behind, worse, terrains, place } = you;
    foot.replaceChildren(row(`${place} of ${ranked}`, "You", true, { behind, worse, terrains }));
  } else if (you && !you.place && rows.length && !comparing) foot.replaceChildren(create("tr", [create("td", missingText(task, period, you), { colspan: "5" })]));
  else foot.replaceChildren();
  const choose = create("a", "Choose a name to stand here by it", { href: "me#name" });
  own.replaceChildren(...(you?.name ? [] : [choose, ". "]), comparingText(task, comparing, rows.length > 0));
}
