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

/** @param {Pick<Task, "round" | "nameOf" | "expert">} task @param {Pick<Answers.People, "you" | "fewest" | "ranked">} answer
 * @returns {string} which place somebody has, or what they lack */
export function placeText({ round, nameOf, expert }, { you, fewest, ranked }) {
  if (you?.place) return `You are ${you.place} of ${many(ranked, "person", "people")}.`;
  if (you?.comparing) return `Not all of your ${round}s are compared with ${nameOf(expert ?? "")} yet.`;
  return you?.terrains ? `${many(you.missing, `more ranked ${round}`)}, and you have a place.` : `${many(fewest, `ranked ${round}`)}, and you have a place.`;
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
const NOTHING = "\u2013";

/** @param {number | null} behind @param {number | null} worse @param {number} most @returns the mean as a bar, and its worse end */
function bar(behind, worse, most) {
  const width = (/** @type {number | null} */ moves) => `width: ${100 * Math.min(1, Math.max(0, (moves ?? 0) / most))}%`;
  return create("td", create("div", [create("i", [], { style: width(worse) }), create("i", [], { style: width(behind) })], { class: "bar", "aria-hidden": "true" }), { class: "wide" });
}

/** @param {string | number} place @param {string} name @param {boolean} isYou
 * @param {{behind: number | null, worse: number | null, terrains: number}} figures @param {number} most moves that a terrain counts */
function row(place, name, isYou, { behind, worse, terrains }, most) {
  const label = create("th", [name, ...(isYou && name !== "You" ? [create("small", "you")] : [])], { scope: "row" });
  const numbers = [...[behind, worse].map((moves) => [moves === null ? NOTHING : signed(moves), "number"]), [String(terrains), "number wide"]];
  const cells = [create("td", String(place), { class: "number place" }), label, bar(behind, worse, most), ...numbers.map(([text, kind]) => create("td", text, { class: kind }))];
  return create("tr", cells, isYou ? { "aria-current": "true" } : {});
}

/** Show what fills a table without anybody, and how much of it whoever asks has.
 * @param {Task} task @param {"week" | "all"} period @param {Answers.People} answer */
function invitation(task, period, answer) {
  const { you, fewest, comparing } = answer;
  const played = Array.from({ length: fewest }, (_, at) => create("i", [], at < (you?.terrains ?? 0) ? { class: "done" } : {}));
  const play = create("a", "Play ranked", { class: "go", href: "./?mode=ranked" });
  // while the expert plays, nobody can say who has how many
  const text = comparing ? fillingText(task, fewest) : emptyText(task, period, answer);
  const parts = [create("p", played, { class: "slots", "aria-hidden": "true" }), create("p", text), create("p", [play], { class: "buttons" })];
  return create("tr", [create("td", parts, { class: "empty", colspan: "6" })]);
}

/** @param {Answers.People} answer @returns the row of whoever asks, null where it is in sight */
function ownRow({ people, you, ranked, most_behind: most }) {
  if (you?.place) return you.place > NEAR ? row(`${you.place} of ${ranked}`, "You", true, you, most) : null;
  if (!people.length) return null; // the invitation says it
  return row(NOTHING, you?.name ?? "You", true, you ?? { behind: null, worse: null, terrains: 0 }, most);
}

/** Fill the table; whoever asks stands in sight, wherever they are in it.
 * @param {HTMLTableElement} table @param {HTMLElement} own @param {Task} task @param {"week" | "all"} period
 * @param {Answers.People} answer */
export function paintPeople(table, own, task, period, answer) {
  const { people, you, comparing, most_behind: most } = answer;
  const rows = people.map((person) => row(person.place, person.name ?? (person.you ? "You" : "Somebody"), person.you, person, most));
  table.tBodies[0].replaceChildren(...(rows.length ? rows : [invitation(task, period, answer)]));
  table.querySelector(".axis")?.replaceChildren(...[0, most / 2, most].map((moves) => create("span", String(moves))));
  const mine = ownRow(answer);
  /** @type {HTMLTableSectionElement} */ (table.tFoot).replaceChildren(...(mine ? [mine] : []));
  const choose = create("a", "Choose a name to stand here by it", { href: "me#name" });
  const play = create("a", "Play ranked", { class: "go", href: "./?mode=ranked" });
  const says = rows.length ? [create("b", placeText(task, answer))] : [];
  const sentences = create("span", [...says, " ", ...(you?.name ? [] : [choose, ". "]), comparingText(task, comparing, rows.length > 0)]);
  own.replaceChildren(sentences, ...(rows.length ? [play] : [])); // the invitation has one
}
