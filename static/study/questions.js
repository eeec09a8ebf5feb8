// Questions on the page: drawn from what the server shows, and read again as the answers that are sent.
import { all, create, put } from "../common/page.js";
import { LANGUAGE, t } from "../common/texts.js";

const DECLINE = t("block.decline", "Prefer not to say");
const DECLINED = "declined";
const UNSET = t("block.unset", "Not answered yet");

/** Return the radio buttons of a group, each with its text.
 * @param {string} group @param {{value: number | string, text: string}[]} choices @param {unknown} [chosen] */
export const radios = (group, choices, chosen) => choices.map(({ value, text }) =>
  create("label", [ticked("radio", group, String(value), value === chosen), text]));

/** @param {"radio" | "checkbox"} type @param {string} name @param {string} value @param {boolean} isTicked */
function ticked(type, name, value, isTicked) {
  const input = create("input", [], { type, name, value });
  input.checked = isTicked;
  return input;
}

/** @param {string} name of a question @param {string} part @returns the id of a part of it, which no other part of the page has */
const idOf = (name, part) => `question-${name}-${part}`;

/** Return a question with its number, and the place of what is said of its answer.
 * @param {string} name @param {string} title @param {(string | Node)[]} content */
export const fieldset = (name, title, content) => create("fieldset", [
  create("legend", title, { id: idOf(name, "title") }), ...content, create("p", [], { class: "verdict", id: idOf(name, "verdict"), hidden: "" }),
], { "data-testid": `question-${name}`, "aria-describedby": idOf(name, "verdict") });

/** @param {ParentNode} root @param {string} group @returns the value that is chosen in a group of radio buttons; null for none */
export const chosenIn = (root, group) => root.querySelector(`input[name="${group}"]:checked`)?.getAttribute("value") ?? null;

/** @param {ParentNode} root @returns {HTMLInputElement[]} */
const inputs = (root) => /** @type {HTMLInputElement[]} */ (all("input:not([data-decline]), textarea", root));
/** @param {string | null} value @returns {Study.Sent | undefined} */
const index = (value) => (value === null ? undefined : value === DECLINED ? null : Number(value));

/** How each kind is drawn, and read: undefined is left out, and a sentence says what is wrong with it.
 * @type {Record<Answers.ShownQuestion["kind"], Study.Kind>} */
const KINDS = {
  choice: {
    draw: ({ name, choices }, sent) => radios(name, [...choices ?? [], { value: DECLINED, text: DECLINE }], sent === null ? DECLINED : sent),
    read: ({ name }, root) => index(chosenIn(root, name)),
  },
  several: {
    draw: ({ name, choices }, sent) => (choices ?? []).map(({ value, text }) =>
      create("label", [ticked("checkbox", name, String(value), Array.isArray(sent) && sent.includes(value)), text])),
    read: (_, root) => {
      const chosen = inputs(root).filter((input) => input.checked).map((input) => Number(input.value));
      return chosen.length ? chosen : undefined;
    },
  },
  likert: {
    draw: ({ name, rows, points }, sent) => (rows ?? []).map((row, number) => create("div", [
      create("p", row, { id: idOf(name, `row-${number}`) }),
      create("div", radios(`${name}-${number}`, (points ?? []).map((text, value) => ({ value, text })), Array.isArray(sent) ? sent[number] : undefined), { class: "points" }),
    ], { class: "likert", role: "radiogroup", "aria-labelledby": idOf(name, `row-${number}`) })),
    read: ({ name, rows, needed }, root) => {
      const chosen = (rows ?? []).map((_, number) => index(chosenIn(root, `${name}-${number}`)) ?? null);
      if (chosen.every((point) => point === null)) return undefined;
      if (needed && chosen.includes(null)) throw new Error(t("block.rows", "Please choose in every row."));
      return /** @type {number[]} */ (chosen);
    },
  },
  scale: {
    draw: ({ name, steps, low, high }, sent) => drawScale(name, steps ?? 2, low ?? "", high ?? "", typeof sent === "number" ? sent : null),
    read: (_, root) => {
      const [input] = inputs(root);
      return input.dataset.set === "true" ? Number(input.value) : undefined;
    },
  },
  number: {
    draw: ({ name, unit, whole }, sent) => [create("p", [create("input", [], {
      type: "text", inputmode: whole ? "numeric" : "decimal", size: "8", autocomplete: "off", value: typeof sent === "number" ? String(sent) : "",
      "aria-labelledby": `${idOf(name, "title")} ${idOf(name, "unit")}`,
    }), create("span", unit ?? "", { id: idOf(name, "unit") })], { class: "typed" })],
    read: ({ minimum, maximum, whole }, root) => {
      const text = inputs(root)[0].value.trim();
      if (!text) return undefined;
      // "1,000" is a thousand to some and 1 to others, and so is "1.000" in other languages, and where only whole numbers are asked for
      if ((whole || LANGUAGE !== "en" ? /[.,]\d{3}/ : /,\d{3}/).test(text)) {
        throw new Error(whole ? t("block.no_thousands", "Please type {number} without a mark between thousands.", { number: text })
          : t("block.no_thousands_point", "Please type {number} without a mark between thousands, and with a point before decimals.", { number: text }));
      }
      const number = Number(text.replace(",", "."));
      if (Number.isFinite(number) && number >= (minimum ?? number) && number <= (maximum ?? number) && !(whole && number % 1)) return number;
      throw new Error(whole ? t("block.whole", "Please type a whole number from {minimum} to {maximum}.", { minimum, maximum }) : t("block.number", "Please type a number from {minimum} to {maximum}.", { minimum, maximum }));
    },
  },
  text: {
    draw: ({ name, long, max_length }, sent) => [drawText(name, Boolean(long), max_length ?? 300, typeof sent === "string" ? sent : "")],
    read: (_, root) => inputs(root)[0].value.trim() || undefined,
  },
  statement: {
    draw: ({ name }, sent) => [create("label", [ticked("checkbox", name, "yes", sent === true), t("block.agree", "I agree")])],
    read: (_, root) => (inputs(root)[0].checked ? true : undefined),
  },
};

/** Return the steps between two ends; none is chosen before somebody touches it.
 * @param {string} name @param {number} steps @param {string} low @param {string} high @param {number | null} step */
function drawScale(name, steps, low, high, step) {
  const input = create("input", [], {
    type: "range", min: "0", max: String(steps - 1), step: "1", value: String(step ?? Math.floor(steps / 2)), "aria-labelledby": idOf(name, "title"),
    "aria-describedby": idOf(name, "ends"),
  });
  const output = create("output", []);
  input.style.setProperty("--gaps", String(steps - 1));
  /** @param {boolean} isSet */
  const show = (isSet) => {
    input.dataset.set = String(isSet);
    const text = isSet ? t("block.step_of", "{number} of {of}", { number: Number(input.value) + 1, of: steps }) : UNSET;
    input.setAttribute("aria-valuetext", text);
    put(output, text);
  };
  for (const event of ["input", "pointerup"]) input.addEventListener(event, () => show(true));
  input.addEventListener("keydown", ({ key }) => { if (key === " " || key === "Enter") show(true); });
  show(step !== null);
  return [create("p", [create("span", low), create("span", high)], { class: "ends", id: idOf(name, "ends") }), input, output];
}

/** @param {string} name @param {boolean} isLong @param {number} max_length characters @param {string} text */
function drawText(name, isLong, max_length, text) {
  const attributes = { maxlength: String(max_length), "aria-labelledby": idOf(name, "title"), autocomplete: "off" };
  const input = isLong ? create("textarea", [], { ...attributes, rows: "4" }) : create("input", [], { ...attributes, type: "text" });
  input.value = text;
  return input;
}

/** Return the question of a block as it is on the page.
 * @param {Answers.ShownQuestion} question @param {number} number from 0 @param {Study.Sent | undefined} sent what was answered before */
export function draw(question, number, sent) {
  const { kind, name, needed, declinable } = question;
  const content = KINDS[kind].draw(question, sent);
  const element = fieldset(name, `${number + 1}. ${question.question}`, content);
  element.dataset.kind = kind;
  if (!needed) element.querySelector("legend")?.append(create("small", ` ${t("block.optional", "optional")}`));
  if (declinable && kind !== "choice") {
    const decline = create("input", [], { type: "checkbox", "data-decline": "" });
    const show = () => { for (const input of inputs(element)) input.disabled = decline.checked; };
    decline.checked = sent === null;
    decline.addEventListener("change", show);
    show();
    element.querySelector(".verdict")?.before(create("label", [decline, DECLINE], { class: "decline" }));
  }
  return element;
}

/** Return what is sent for a question: undefined where it is left out. An error says what is missing.
 * @param {Answers.ShownQuestion} question @param {HTMLElement} element as `draw` returned it */
export function read(question, element) {
  const declines = /** @type {HTMLInputElement | null} */ (element.querySelector("[data-decline]"))?.checked;
  const sent = declines ? null : KINDS[question.kind].read(question, element);
  if (sent === undefined && question.needed) throw new Error(t("block.needed", "Please answer this question, or choose “{decline}”.", { decline: DECLINE }));
  return sent;
}
