// @ts-check
// Where moves were lost: the list of an episode's biggest losses, for the playground's end card and the study's debrief.
import { create } from "./page.js";
import { many } from "./words.js";

/** @param {Loss} loss @returns the sentence of one loss */
export function lossLine({ step, regret, action, best_action, kind }) {
  const why = { "hidden pocket": ", leaving a pocket behind", "last cells": ", on the last cells" }[kind] ?? "";
  return `Move ${step + 1}: you lost ${many(regret, "move")} going ${action} instead of ${best_action}${why}.`;
}

/** @param {Regret} regret @returns the sentence above the list */
export function regretLine({ policy, losses, given_up }) {
  if (given_up > 0) return `Giving up cost ${many(given_up, "move")}: ${policy} would have finished from there.`;
  if (!losses.length) return "No single move cost you much.";
  return `Judged with the whole terrain known, and ${policy} going on after each move.`;
}

/** Fill a place with the losses of an episode, the greatest first, each with a button.
 * @param {HTMLElement} place @param {Regret} regret
 * @param {{label: string, onChoose: (loss: Loss) => void}} button what it says and does */
export function paintLosses(place, regret, { label, onChoose }) {
  const list = place.ownerDocument.createElement("ol");
  for (const loss of regret.losses) {
    const item = create("li", `${lossLine(loss)} `);
    const choose = /** @type {HTMLButtonElement} */ (create("button", label, { type: "button", class: "quiet" }));
    choose.setAttribute("aria-label", `${label}: move ${loss.step + 1}`);
    choose.addEventListener("click", () => onChoose(loss));
    item.append(choose);
    list.append(item);
  }
  place.replaceChildren(create("p", regretLine(regret)), list);
}
