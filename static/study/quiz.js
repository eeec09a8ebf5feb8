// @ts-check
// The understanding questions: chosen answers stay, a wrong one is explained, and one may try again.

import { create, elementsOf } from "../common/page.js";
import { questionsTitle } from "./words.js";

const AGAIN = "Not this one. The rules below say it: have another look, then choose again.";

/** @param {Document} page @param {(answers: number[]) => void} onAnswers */
export function createQuiz(page, onAnswers) {
  const by = elementsOf(page);
  const form = by("quiz", HTMLFormElement);
  /** @type {{question: string, choices: string[]}[]} */
  let asked = [];
  /** @type {boolean[] | null} */
  let shown = null;

  /** @param {{question: string, choices: string[]}} each @param {number} number */
  function item({ question, choices }, number) {
    const labels = choices.map((choice, value) =>
      create("label", [create("input", [], { type: "radio", name: `q${number}`, value: String(value) }), choice]));
    const verdict = create("p", [], { class: "verdict", id: `verdict-${number}`, hidden: "" });
    const field = create("fieldset", [create("legend", `${number + 1}. ${question}`), ...labels, verdict], { "data-testid": `question-${number}` });
    return field;
  }
  /** @param {number} number @returns {number} -1 while nothing is chosen */
  const chosen = (number) => Number(/** @type {HTMLInputElement | null} */ (form.querySelector(`[name=q${number}]:checked`))?.value ?? -1);

  form.addEventListener("submit", (event) => {
    event.preventDefault();
    const answers = asked.map((_, number) => chosen(number));
    const open = answers.indexOf(-1);
    if (open < 0) return onAnswers(answers);
    by("quiz-status").textContent = `Please choose an answer to question ${open + 1} as well.`;
    /** @type {HTMLElement | null} */ (form.querySelector(`[name=q${open}]`))?.focus();
  });
  form.addEventListener("change", (event) => {
    const field = /** @type {HTMLElement} */ (event.target).closest("fieldset");
    if (!field) return;
    delete field.dataset.right;
    /** @type {HTMLElement} */ (field.querySelector(".verdict")).hidden = true;
    by("quiz-status").textContent = "";
  });
  /** @param {Study.Participant} participant */
  function showVerdicts({ right, why }) {
    if (!right || right === shown) return;
    shown = right;
    form.querySelectorAll("fieldset").forEach((field, number) => {
      field.dataset.right = String(right[number]);
      const verdict = /** @type {HTMLElement} */ (field.querySelector(".verdict"));
      verdict.hidden = false;
      verdict.textContent = right[number] ? "That is right." : why?.[number] || AGAIN;
    });
    const wrong = right.filter((each) => !each).length;
    by("quiz-status").textContent = wrong === 0 ? "" : wrong === 1 ? "One answer is not right yet." : `${wrong} answers are not right yet.`;
    if (wrong > 0) by("rules", HTMLDetailsElement).open = true;
    /** @type {HTMLElement | null} */ (form.querySelector(`[name=q${right.indexOf(false)}]:checked`))?.focus();
  }
  return {
    /** @param {Study.Participant} participant */
    paint(participant) {
      if (JSON.stringify(asked) !== JSON.stringify(participant.questions)) {
        asked = participant.questions;
        by("quiz-list").replaceChildren(...asked.map(item));
        by("quiz-title").textContent = questionsTitle(asked.length, "short");
        if (asked.length === 0) onAnswers([]);
      }
      showVerdicts(participant);
    },
  };
}
