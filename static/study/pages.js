// The screens that are read: consent, instructions, questions, ready, break, the end; and the dialogs. Filled from the state, touched
// only where it changed.
import { all, by, create, put } from "../common/page.js";
import { LANGUAGE, plural, t } from "../common/texts.js";
import { capital } from "../common/words.js";
import { askForCode } from "./code_dialog.js";
import { paintElsewhere } from "./elsewhere.js";
import { chosenIn, fieldset, radios } from "./questions.js";
import { screenOf } from "./state.js";
import { dispatch, go, state, study } from "./store.js";
import * as words from "./words.js";

/** @param {string[]} lines */
const paragraphs = (lines) => lines.map((text) => create("p", text));

const sections = all("main > [data-screen]");
/** @type {string | null} */
let shownScreen = null;

/** Show one screen, and give it the focus unless it is the first.
 * @param {string} screen */
function show(screen) {
  if (shownScreen === screen) return;
  const isFirst = shownScreen === null || shownScreen === "loading";
  shownScreen = screen;
  document.body.dataset.screen = screen;
  for (const section of sections) section.hidden = section.dataset.screen !== screen;
  const current = sections.find((section) => section.dataset.screen === screen);
  const target = screen === "play" ? by("field") : current?.querySelector("h1");
  if (!isFirst || screen === "play") target?.focus({ preventScroll: true });
  scrollTo(0, 0);
}
/** @param {Study.Participant} participant */
function paintConsent({ title, consent, invited, languages }) {
  paintLanguages(languages);
  put(by("consent-title"), title);
  by("consent-text").replaceChildren(...paragraphs(consent.text.split(/\n\s*\n/)));
  put(by("consent-version"), consent.version);
  const file = new Blob([`${title}\n${t("consent.file", "Consent text, version {version}", { version: consent.version })}\n\n${consent.text}\n`], { type: "text/plain;charset=utf-8" });
  by("save-consent", HTMLAnchorElement).href = URL.createObjectURL(file);
  by("consent-invited").hidden = !invited;
}
/** Offer the study's languages, each by its own name.
 * @param {string[]} languages */
function paintLanguages(languages) {
  by("languages").hidden = languages.length < 2;
  by("languages").replaceChildren(...languages.map((language) => {
    const name = new Intl.DisplayNames([language], { type: "language" }).of(language) ?? language;
    const attributes = { type: "button", class: "bare", lang: language, "data-testid": `language-${language}`, "aria-pressed": String(language === LANGUAGE) };
    const button = create("button", capital(name), attributes);
    button.addEventListener("click", () => go(async () => {
      const participant = await study.settings({ language });
      location.reload(); // the page comes in that language
      return participant;
    }, "consent"));
    return button;
  }));
}
/** Put the numbers of the protocol into the page's own sentences.
 * @param {Study.Participant} participant */
function paintRules({ rules }) {
  for (const place of all("[data-rule]")) put(place, rules[place.dataset.rule ?? ""] ?? "");
}
/** @param {Study.Participant} participant */
function paintReady(participant) {
  const { title, lines, go } = words.readyText(participant);
  put(by("ready-step"), words.progress(participant, false));
  put(by("ready-title"), title);
  put(by("begin"), go);
  by("ready-lines").replaceChildren(...paragraphs(lines));
}
/** @param {Study.Participant} participant */
function paintComplete({ debrief, participant }) {
  by("look-back-line").hidden = !debrief?.ranked_terrains;
  put(by("label"), participant);
}
/** Show the code, the way back or the sentence of somebody's end on the screen that has a place for it.
 * @param {Study.Participant} participant @param {Study.Screen} screen */
function paintEnding({ ending }, screen) {
  const place = document.querySelector(`section[data-screen=${screen}] [data-ending]`);
  if (!place) return;
  place.append(by("ending"));
  const { code = null, address = null, sentence = null } = ending ?? {};
  by("ending-sentence").hidden = sentence === null;
  put(by("ending-sentence"), sentence ?? "");
  by("code-part").hidden = code === null;
  put(by("code"), code ?? "");
  put(by("code-name"), screen === "complete" ? t("complete.code", "This is your completion code:") : t("left.code", "This is your code:"));
  by("return-line").hidden = address === null;
  if (address !== null) by("return", HTMLAnchorElement).href = address;
}

/** @param {Study.State | null} before */
export function paintPages(before) {
  const { participant, problem } = state;
  const screen = screenOf(state);
  if (participant !== before?.participant || screen !== (before && screenOf(before))) {
    if (participant) {
      put(by("title"), participant.title);
      paintRules(participant);
      by("further-instructions").replaceChildren(...paragraphs(participant.instructions.split(/\n\s*\n/).filter(Boolean)));
      put(by("progress"), words.progress(participant, screen === "play" && !state.game.player?.frame.outcome));
      by("progress-bar").style.width = `${(100 * words.share(participant)).toFixed(1)}%`;
      document.title = `${participant.title} \u00b7 ${words.progress(participant, false)}`;
      put(by("withdrawn-title"), words.withdrawnTitle(participant));
      put(by("withdrawn-lead"), words.withdrawnLead(participant));
      if (participant.note) put(by("withdrawn-note"), participant.note);
    }
    if (participant) {
      const hasPlayed = participant.stage !== "consent";
      by("leave-erase").hidden = !hasPlayed || !participant.can_be_erased;
      put(by("leave-now"), hasPlayed ? t("leave.keep", "Leave, and keep what I have played without my name") : t("leave.button", "Leave the study"));
    }
    if (participant && screen === "consent") paintConsent(participant);
    if (participant && screen === "ready") paintReady(participant);
    if (participant && screen === "break") put(by("break-line"), words.breakLine(participant));
    if (participant && screen === "complete") paintComplete(participant);
    if (participant) paintEnding(participant, screen);
    if (screen === "problem") put(by("problem"), words.sentence(problem ?? ""));
    by("open-leave").hidden = !participant || participant.ending !== null || ["debrief", "complete", "withdrawn", "problem", "loading"].includes(screen);
    show(screen);
  }
  if (participant && screen === "questions" && before?.participant !== participant) paintQuiz(participant);
  if (participant && participant !== before?.participant) {
    paintSupervision(participant);
    paintElsewhere(participant);
  }
}

const AGAIN = t("questions.again", "Not this one. The rules below say it: have another look, then choose again.");
const answer = (/** @type {number[]} */ answers) => go(() => study.answers(answers), "questions");
const form = by("quiz", HTMLFormElement);
/** @type {{question: string, choices: string[]}[] | null} */
let asked = null;
/** @type {boolean[] | null} */
let judged = null;

/** @param {{question: string, choices: string[]}} each @param {number} number */
function item({ question, choices }, number) {
  const labels = radios(`q${number}`, choices.map((text, value) => ({ value, text })));
  return fieldset(String(number), `${number + 1}. ${question}`, labels);
}
/** @param {number} number @returns {number} -1 while nothing is chosen */
const chosen = (number) => Number(chosenIn(form, `q${number}`) ?? -1);

form.addEventListener("submit", (event) => {
  event.preventDefault();
  const answers = (asked ?? []).map((_, number) => chosen(number));
  const open = answers.indexOf(-1);
  if (open < 0) return answer(answers);
  by("quiz-status").textContent = t("questions.open", "Please choose an answer to question {number} as well.", { number: open + 1 });
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
  if (!right || right === judged) return;
  judged = right;
  form.querySelectorAll("fieldset").forEach((field, number) => {
    field.dataset.right = String(right[number]);
    const verdict = /** @type {HTMLElement} */ (field.querySelector(".verdict"));
    verdict.hidden = false;
    verdict.textContent = right[number] ? t("questions.right", "That is right.") : why?.[number] || AGAIN;
  });
  const wrong = right.filter((each) => !each).length;
  by("quiz-status").textContent = wrong === 0 ? "" : plural("questions.wrong", wrong, "{n} answer is not right yet.", "{n} answers are not right yet.");
  if (wrong > 0) document.querySelector("details.rules")?.setAttribute("open", "");
  /** @type {HTMLElement | null} */ (form.querySelector(`[name=q${right.indexOf(false)}]:checked`))?.focus();
}

/** @param {Study.Participant} participant */
function paintQuiz(participant) {
  if (JSON.stringify(asked) !== JSON.stringify(participant.questions)) {
    asked = participant.questions;
    by("quiz-list").replaceChildren(...asked.map(item));
    by("quiz-title").textContent = words.shortQuestionsTitle(asked.length);
    if (asked.length === 0) answer([]);
  }
  put(by("quiz-lead"), words.quizLead(participant.tries_left));
  showVerdicts(participant);
}

for (const dialog of document.querySelectorAll("dialog")) {
  for (const opener of [by(`open-${dialog.id}`), ...document.querySelectorAll(`[data-open=${dialog.id}]`)]) {
    opener.addEventListener("click", () => {
      if (dialog.id === "map") fillMap();
      dialog.showModal();
    });
  }
  dialog.addEventListener("click", (event) => {
    if (event.target === dialog || /** @type {Element} */ (event.target).closest("[data-close]")) dialog.close();
  });
  dialog.addEventListener("close", () => { if (state.isPaused) by("resume").focus(); });
}
by("disagree").addEventListener("click", () => by("leave", HTMLDialogElement).showModal());

function fillMap() {
  const { player, task } = state.game;
  if (!player || !task) return;
  const { line, rows } = task.inWords(player.frame, t("map.name", "the {round}", { round: task.round }));
  by("map-here").textContent = line;
  by("map-rows").replaceChildren(...rows.map((text) => create("li", text)));
}

askForCode("supervise", async (code) => {
  dispatch({ kind: "participant", participant: await study.supervise(code) });
  by("supervise", HTMLDialogElement).close();
});

/** @param {Study.Participant} participant */
function paintSupervision(participant) {
  for (const line of all("[data-supervised]")) put(line, words.supervisedLine(participant.supervised_until_ms, Date.now()));
}
