// Wires the operator's console: log in, ask every two seconds, paint; an answer of 401 leads back to the login.
import { ApiError, request } from "../common/api.js";
import { create, by } from "../common/page.js";
import { loadTask } from "../common/task.js";
import { many } from "../common/words.js";
import { createLive, MAX_BOARDS } from "./live.js";
import { createRecruiting } from "./tables.js";
import * as tables from "./tables.js";
import { attention, exportText, summary } from "./words.js";

const EVERY_MS = 2000;
const password = by("password", HTMLInputElement);
const typed = by("typed", HTMLInputElement);
const live = createLive(by("boards"));

/** @type {{chosen: string, overview: Admin.Overview | null, study: Admin.Study | null, task: Task}} */
let state = { chosen: decodeURIComponent(location.hash.slice(1)), overview: null, study: null, task: await loadTask(null) };
let timer = 0;
Object.defineProperty(window, "mars", { value: Object.freeze({ get state() { return state; } }) });

/** @param {boolean} isIn */
function enter(isIn) {
  document.body.dataset.in = isIn ? "yes" : "no";
  if (isIn) return;
  clearTimeout(timer);
  state = { ...state, overview: null, study: null };
  live.sync([]);
  password.focus();
}

async function load() {
  clearTimeout(timer);
  try {
    /** @type {Admin.Overview} */
    const overview = await request("admin/overview");
    const { studies } = overview;
    const usable = studies.filter(({ status }) => status === "open" || status === "closed");
    const chosen = usable.some(({ name }) => name === state.chosen) ? state.chosen : (usable.find(({ status }) => status === "open") ?? usable[0])?.name ?? "";
    /** @type {Admin.Study | null} */
    const study = chosen ? await request(`admin/studies/${encodeURIComponent(chosen)}`, undefined, 60000) : null;
    state = { chosen, overview, study, task: await loadTask(study?.task) };
    enter(true);
    paint();
    showLink("open");
  } catch (error) {
    if (error instanceof ApiError && error.status === 401) return enter(false);
    showLink("lost", /** @type {Error} */ (error).message);
  }
  timer = setTimeout(next, EVERY_MS);
}
const next = () => { if (document.hidden) timer = setTimeout(next, EVERY_MS); else load(); };

/** @param {"open" | "lost"} link @param {string} [why] */
function showLink(link, why = "") {
  by("link").dataset.link = link;
  /** @type {HTMLElement} */ (by("link").lastElementChild).textContent = link === "open" ? "live" : "not live";
  by("link").title = why;
}

/** @param {string} text */
function notice(text) {
  const button = create("button", "Dismiss", { type: "button", class: "quiet" });
  const line = create("p", [text, button]);
  button.addEventListener("click", () => line.remove());
  by("notices").replaceChildren(line);
}

function paint() {
  const { overview, study, chosen } = state;
  if (!overview) return;
  document.body.dataset.study = study ? "some" : "none";
  paintStudies(overview.studies, chosen);
  const mine = overview.boards.filter((board) => board.study === chosen);
  const boards = [...mine, ...overview.boards.filter((board) => board.study !== chosen)];
  live.sync(boards);
  by("live-count").textContent = boards.length === 0 ? "nobody plays at this moment" : boards.length > MAX_BOARDS ? `${MAX_BOARDS} of ${boards.length}` : String(boards.length);
  tables.paintHealth(by("health"), overview.health, overview.now_ms);
  tables.paintActions(by("actions", HTMLTableElement), overview.actions, overview.now_ms);
  by("operator").textContent = `you are ${overview.operator}`;
  if (study) paintStudy(study, state.task, overview);
}

/** @param {Admin.Listed[]} studies @param {string} chosen */
function paintStudies(studies, chosen) {
  const select = by("study", HTMLSelectElement);
  const key = JSON.stringify(studies);
  if (select.dataset.shown !== key) {
    select.dataset.shown = key;
    select.replaceChildren(...studies.map(({ name, status }) => Object.assign(new Option(`${name} (${status})`, name), { disabled: status === "draft" || status === "broken" })));
    for (const { error } of studies) if (error) notice(error);
  }
  select.value = chosen;
  /** @type {HTMLElement} */ (select.closest("label")).hidden = studies.length === 0;
  if (chosen) return;
  by("title").textContent = studies.length ? "No study is open" : "No study yet";
  by("summary").textContent = studies.length ? "Drafts become studies with `marsexplorer study freeze NAME`." : "Begin one with `marsexplorer study new NAME`, then `marsexplorer study freeze NAME`: it appears here at once.";
  by("status").hidden = true;
}

/** @param {Admin.Study} study @param {Task} task that it is about @param {Admin.Overview} overview */
function paintStudy(study, task, overview) {
  const isOpen = study.status === "open";
  by("title").textContent = study.title;
  by("summary").textContent = summary(study);
  by("status").hidden = false;
  by("status").textContent = by("status").dataset.status = study.status;
  tables.paintStages(by("stages", HTMLTableElement), study.stages);
  tables.paintFigure(by("figure"), by("figure-words"), task, study);
  tables.paintAttention(by("attention"), attention(study, overview.health));
  tables.paintPeople(by("people", HTMLTableElement), task, study);
  recruiting.paint(study);
  const { report, release } = study.exports;
  tables.paintExport(by("report"), exportText(report, "HTML and JSON, with everything the study can say so far.", study.now_ms), report, study.name);
  tables.paintExport(by("release"), exportText(release, isOpen ? "The citable bundle, once the study is closed." : "The citable bundle: data, documents, signed manifest, as one zip.", study.now_ms), release, study.name);
  const isBusy = report?.state === "making" || release?.state === "making";
  by("make-report", HTMLButtonElement).disabled = isBusy;
  by("make-release", HTMLButtonElement).disabled = isBusy || isOpen || study.participants.length === 0;
  /** @type {HTMLElement} */ (by("authors").closest("p")).hidden = isOpen;
  /** @type {HTMLElement} */ (by("close").closest("div")).hidden = !isOpen;
}

/** Do what was asked, show what went wrong, and load the console again.
 * @param {() => Promise<unknown>} work */
async function run(work) {
  try {
    await work();
  } catch (error) {
    notice(/** @type {Error} */ (error).message);
  }
  await load();
}

by("login").addEventListener("submit", async (event) => {
  event.preventDefault();
  by("wrong").textContent = "";
  try {
    await request("admin/login", { name: by("name", HTMLInputElement).value, password: password.value });
    password.value = "";
    await load();
  } catch (error) {
    by("wrong").textContent = /** @type {Error} */ (error).message;
    password.select();
  }
});
by("logout").addEventListener("click", async () => {
  await request("admin/logout", {}).catch(() => {});
  enter(false);
});
by("study").addEventListener("change", () => {
  state = { ...state, chosen: by("study", HTMLSelectElement).value };
  history.replaceState(null, "", `#${encodeURIComponent(state.chosen)}`);
  load();
});
const recruiting = createRecruiting({ ask: (path, body) => request(ofStudy(path), body), run });
const ofStudy = (/** @type {string} */ rest) => `admin/studies/${encodeURIComponent(state.chosen)}/${rest}`;
by("make-report").addEventListener("click", () => run(() => request(ofStudy("exports/report"), {})));
by("make-release").addEventListener("click", () => {
  const authors = by("authors", HTMLInputElement).value.split(",").map((name) => name.trim()).filter(Boolean);
  run(() => request(ofStudy("exports/release"), { authors }));
});
by("check").addEventListener("click", () => run(() => request("admin/check", {}, 600000)));

by("close").addEventListener("click", () => {
  const under = state.study?.participants.filter(({ kind, stage }) => kind === "human" && !["debrief", "complete", "withdrawn"].includes(stage)).length ?? 0;
  by("confirm-words").textContent = `${under ? `${many(under, "person is", "people are")} on the way and cannot finish. ` : "Nobody is on the way. "}The secret behind the terrains of ${state.chosen} is revealed, and nothing takes that back.`;
  typed.value = "";
  by("close-now", HTMLButtonElement).disabled = true;
  by("confirm", HTMLDialogElement).showModal();
});
typed.addEventListener("input", () => { by("close-now", HTMLButtonElement).disabled = typed.value !== state.chosen; });
by("keep-open").addEventListener("click", () => by("confirm", HTMLDialogElement).close());
by("confirm-form").addEventListener("submit", (event) => {
  if (typed.value !== state.chosen) return event.preventDefault();
  return run(() => request(ofStudy("close"), { name: typed.value }));
});
load();
