// Whom to pay: the texts of the outcomes, and the list of everybody who agreed, with its files.
import { by, create, put } from "../common/page.js";
import { many } from "../common/words.js";
import { unfold } from "./tables.js";

/** @param {Admin.ConsoleStudy} study */
export function paintOutcomes({ name, outcomes, outcomes_problem: problem }) {
  const place = by("outcome-list");
  put(by("outcomes-problem"), problem);
  by("outcomes-problem").hidden = problem === "";
  by("save-outcomes").hidden = problem !== "";
  unfold(by("outcomes-part"), problem);
  const key = JSON.stringify([name, outcomes]);
  if (place.dataset.shown === key) return; // what is being typed stays
  place.dataset.shown = key;
  place.replaceChildren(...outcomes.map(({ outcome, words, text }) => {
    const input = create("input", [], { name: outcome, value: text, maxlength: "2000", autocomplete: "off", "data-testid": `outcome-${outcome}` });
    return create("label", [create("span", `Whoever ${words}`), input]);
  }));
}

/** @returns {Record<string, string>} the texts as they are typed, by outcome */
export function typedTexts() {
  const inputs = [...by("outcome-list").querySelectorAll("input")];
  return Object.fromEntries(inputs.map(({ name, value }) => [name, value]));
}

/** Take the list away unless it is of this study.
 * @param {string} study */
export function keepPaymentsOf(study) {
  if (by("payments-part").dataset.study !== study) paintPayments(study, null);
}

/** @param {string} study @param {Admin.Payments | null} payments null: the list was not asked for */
export function paintPayments(study, payments) {
  by("payments-part").hidden = payments === null;
  by("payments-part").dataset.study = study;
  const table = by("payments", HTMLTableElement);
  const { columns, rows, csv, bulk, effective_pay: pay, without_consent: without } = payments ?? { columns: [], rows: [], csv: null, bulk: null, effective_pay: "", without_consent: 0 };
  table.tHead?.replaceChildren(create("tr", columns.map((column) => create("th", column.replace("_", " "), { scope: "col" }))));
  table.tBodies[0].replaceChildren(...rows.map((row) => create("tr", row.map((cell, index) => (index ? create("td", cell) : create("th", cell, { scope: "row" }))))));
  put(by("payment-words"), payments ? [`${many(without, "person", "people")} did not agree.`, pay && `${pay}.`].filter(Boolean).join(" ") : "");
  const files = [["payments.csv", csv], ["bonuses.csv", bulk]].filter(([, text]) => text);
  for (const link of by("payment-files").querySelectorAll("a")) URL.revokeObjectURL(link.href);
  by("payment-files").replaceChildren(...files.flatMap(([file, text]) => {
    const href = URL.createObjectURL(new Blob([text ?? ""], { type: "text/csv" }));
    return [create("a", file ?? "", { href, download: `${study}-${file}` }), " "];
  }));
}
