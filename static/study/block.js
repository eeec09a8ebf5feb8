// The screen of a block of questions: it is filled once for each block, keeps what was answered through a reload, and sends it.
import { all, by, put } from "../common/page.js";
import { tabStore } from "../common/storage.js";
import { plural } from "../common/texts.js";
import { keep } from "./actions.js";
import { draw, read } from "./questions.js";
import { go, stage, state, study } from "./store.js";

const form = by("block-form", HTMLFormElement);
const DRAFT = keep("block");
/** The block on the page, and its questions there.
 * @type {{block: Answers.ShownBlock, drawn: HTMLElement[]} | null} */
let asked = null;

/** @param {Answers.ShownBlock} block @returns what a block is known by */
const ident = ({ name, turn }) => `${name} ${turn}`;

/** Fill the screen with a block, unless it is there.
 * @param {Answers.ShownBlock} block */
export function paintBlock(block) {
  if (asked && ident(asked.block) === ident(block)) return;
  const draft = tabStore.read(DRAFT);
  /** @type {Record<string, Study.Sent>} */
  const answers = draft?.of === ident(block) ? draft.answers : {};
  const drawn = block.questions.map((question, number) => draw(question, number, answers[question.name]));
  const follows = asked !== null && document.body.dataset.screen === "block";
  asked = { block, drawn };
  by("block-list").replaceChildren(...drawn);
  put(by("block-title"), block.title);
  put(by("block-intro"), block.intro);
  by("block-intro").hidden = !block.intro;
  by("skip-blocks").hidden = !block.can_be_skipped;
  put(by("block-status"), "");
  if (!follows) return; // another screen gives the focus itself
  by("block-title").focus({ preventScroll: true });
  scrollTo(0, 0);
}

/** Return the answers, and the questions with something to be said of them, in order. */
function readAll() {
  /** @type {Record<string, Study.Sent>} */
  const answers = {};
  /** @type {Map<HTMLElement, string>} */
  const faults = new Map();
  asked?.block.questions.forEach((question, number) => {
    const element = /** @type {HTMLElement} */ (asked?.drawn[number]);
    try {
      const sent = read(question, element);
      if (sent !== undefined) answers[question.name] = sent;
    } catch (error) {
      faults.set(element, /** @type {Error} */ (error).message);
    }
  });
  return { answers, faults };
}

/** @param {HTMLElement} element a question @param {string} text what is said of it; "" for nothing */
function judge(element, text) {
  const verdict = /** @type {HTMLElement} */ (element.querySelector(".verdict"));
  verdict.hidden = text === "";
  put(verdict, text);
  if (text) element.dataset.right = "false";
  else delete element.dataset.right;
}

const pass = (/** @type {() => Promise<Study.Participant>} */ ask) => go(ask, stage());

form.addEventListener("submit", (event) => {
  event.preventDefault();
  if (!asked) return;
  const { answers, faults } = readAll();
  const { name, turn } = asked.block;
  for (const element of asked.drawn) judge(element, faults.get(element) ?? "");
  put(by("block-status"), "");
  if (faults.size === 0) return void pass(() => study.block(name, turn, answers));
  const [first] = faults.keys();
  put(by("block-status"), plural("block.faults", faults.size, "{n} question needs another look.", "{n} questions need another look."));
  all("input:not(:disabled), textarea", first)[0]?.focus();
});
form.addEventListener("input", (event) => {
  const element = /** @type {HTMLElement} */ (event.target).closest("fieldset");
  if (element) judge(element, "");
  if (asked) tabStore.setItem(DRAFT, JSON.stringify({ of: ident(asked.block), answers: readAll().answers }));
});
by("skip-blocks").addEventListener("click", () => {
  if (asked) pass(() => study.skip(asked?.block.name ?? "", asked?.block.turn ?? 0));
});

/** Paint what the state says, once it has changed.
 * @param {Study.State | null} before */
export function paintBlocks(before) {
  const { participant } = state;
  if (!participant || participant === before?.participant) return;
  if (participant.block) paintBlock(participant.block);
  else tabStore.removeItem(DRAFT); // they have answered, or left
}
