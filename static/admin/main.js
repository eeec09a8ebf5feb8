// Wires the operator's console: log in, ask every two seconds, paint; an answer of 401 leads back to the login.
import { ApiError, request } from "../common/api.js";
import { by, create, put } from "../common/page.js";
import { loadTask } from "../common/task.js";
import { many } from "../common/words.js";
import { createLive, MAX_BOARDS } from "./live.js";
import { keepPaymentsOf, paintOutcomes, paintPayments, typedTexts } from "./payments.js";
import * as tables from "./tables.js";
import { ago, attention, exportText, glance, invitationCounts, RECRUITMENT, summary } from "./words.js";

const EVERY_MS = 2000;
const password = by("password", HTMLInputElement);
const typed = by("typed", HTMLInputElement);
const live = createLive(by("boards"));

/** @type {{chosen: string, overview: Admin.Overview | null, study: Admin.ConsoleStudy | null, task: Task}} */
let state = { chosen: decodeURIComponent(location.hash.slice(1)), overview: null, study: null, task: await loadTask() };
let timer = 0;
/** The newest question of `load`: an answer to an earlier one changes nothing. */
let asked = 0;
Object.defineProperty(window, "playground", { value: Object.freeze({ get state() { return state; } }) });

/** @param {boolean} isIn */
function enter(isIn) {
  document.body.dataset.in = isIn ? "yes" : "no";
  if (isIn) return;
  clearTimeout(timer);
  state = { ...state, overview: null, study: null };
  live.sync([]);
  paintPayments("", null);
  password.focus();
}

async function load() {
  clearTimeout(timer);
  const mine = ++asked;
  try {
    /** @type {Admin.Overview} */
    const overview = await request("admin/overview");
    const { studies } = overview;
    const usable = studies.filter(({ status }) => status === "open" || status === "closed");
    const chosen = usable.some(({ name }) => name === state.chosen) ? state.chosen : (usable.find(({ status }) => status === "open") ?? usable[0])?.name ?? "";
    /** @type {Admin.ConsoleStudy | null} */
    const study = chosen ? await request(`admin/studies/${encodeURIComponent(chosen)}`, undefined, 60000) : null;
    const task = await loadTask(study?.task);
    if (mine !== asked) return;
    state = { chosen, overview, study, task };
    enter(true);
    paint();
    showLink("open");
  } catch (error) {
    if (mine !== asked) return;
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
  const warnings = [...by("health").querySelectorAll("[data-tone=warn]")].map((warning) => warning.previousElementSibling?.textContent);
  tables.unfold(by("health-part"), warnings.join(", "));
  tables.paintFailures(by("failures"), overview);
  tables.paintNames(by("names", HTMLTableElement), overview, (name, hidden) => run(() => request("admin/names", { name, hidden })));
  if (study) paintStudy(study, state.task, overview);
}

/** @param {Admin.FolderStudy[]} studies @param {string} chosen */
function paintStudies(studies, chosen) {
  const select = by("study", HTMLSelectElement);
  const key = JSON.stringify(studies);
  if (select.dataset.shown !== key) {
    select.dataset.shown = key;
    select.replaceChildren(...studies.map(({ name, status }) => Object.assign(new Option(`${name} (${status})`, name), { disabled: status !== "open" && status !== "closed" })));
    for (const { error } of studies) if (error) notice(error);
  }
  select.value = chosen;
  /** @type {HTMLElement} */ (select.closest("label")).hidden = studies.length === 0;
  if (chosen) return;
  by("title").textContent = studies.length ? "No study is open" : "No study yet";
  by("summary").textContent = studies.length ? "Drafts become studies with `humanplay study freeze NAME`." : "Begin one with `humanplay study new NAME`, then `humanplay study freeze NAME`: it appears here at once.";
  by("status").hidden = true;
}

/** @param {Admin.ConsoleStudy} study @param {Task} task that it is about @param {Admin.Overview} overview */
function paintStudy(study, task, overview) {
  const isOpen = study.status === "open";
  by("title").textContent = study.title;
  by("summary").textContent = summary(study);
  by("status").hidden = false;
  by("status").textContent = by("status").dataset.status = study.status;
  tables.paintGlance(by("glance"), glance(study, overview.health));
  tables.paintStages(by("stages", HTMLTableElement), study.stages);
  tables.paintFigure(by("figure"), by("figure-words"), task, study);
  tables.paintAttention(by("attention"), attention(study, overview.health));
  put(by("target"), task.target);
  tables.paintPeople(by("people", HTMLTableElement), task, study);
  paintRecruiting(study);
  paintOutcomes(study);
  keepPaymentsOf(study.name);
  const { report, release } = study.exports;
  tables.paintExport(by("report"), exportText(report, isOpen ? "The figures as HTML and JSON, once the study is closed." : "The figures as HTML and JSON.", study.now_ms), report, study.name);
  tables.paintExport(by("release"), exportText(release, isOpen ? "The citable bundle, once the study is closed." : "The citable bundle: data, documents, signed manifest, as one zip.", study.now_ms), release, study.name);
  const isBusy = report?.state === "making" || release?.state === "making";
  by("make-report", HTMLButtonElement).disabled = isBusy || isOpen;
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
    await request("admin/login", { password: password.value });
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
  keepPaymentsOf(state.chosen);
  history.replaceState(null, "", `#${encodeURIComponent(state.chosen)}`);
  load();
});
const ofStudy = (/** @type {string} */ rest) => `admin/studies/${encodeURIComponent(state.chosen)}/${rest}`;
by("make-report").addEventListener("click", () => run(() => request(ofStudy("exports/report"), {})));
by("make-release").addEventListener("click", () => {
  const authors = by("authors", HTMLInputElement).value.split(",").map((name) => name.trim()).filter(Boolean);
  run(() => request(ofStudy("exports/release"), { authors }));
});
by("check").addEventListener("click", () => run(() => request("admin/check", {}, 600000)));

by("outcomes").addEventListener("submit", (event) => {
  event.preventDefault();
  run(() => request(ofStudy("outcomes"), { texts: typedTexts() }));
});
by("list-payments").addEventListener("click", () => run(async () => {
  const { chosen } = state;
  const payments = await request(ofStudy("payments"), {});
  if (chosen === state.chosen && state.overview) paintPayments(chosen, payments); // else another study, or nobody, is shown now
}));

by("close").addEventListener("click", () => {
  const under = state.study?.participants.filter(({ kind, stage }) => kind === "human" && !["debrief", "complete", "withdrawn"].includes(stage)).length ?? 0;
  by("confirm-words").textContent = `${under ? `${many(under, "person is", "people are")} on the way and cannot finish. ` : "Nobody is on the way. "}The secret behind the instances of ${state.chosen} is revealed, and nothing takes that back.`;
  typed.value = "";
  by("at-once", HTMLInputElement).checked = false;
  by("close-now", HTMLButtonElement).disabled = true;
  by("confirm", HTMLDialogElement).showModal();
});
typed.addEventListener("input", () => { by("close-now", HTMLButtonElement).disabled = typed.value !== state.chosen; });
by("keep-open").addEventListener("click", () => by("confirm", HTMLDialogElement).close());
by("confirm-form").addEventListener("submit", (event) => {
  if (typed.value !== state.chosen) return event.preventDefault();
  return run(() => request(ofStudy("close"), { name: typed.value, now: by("at-once", HTMLInputElement).checked }));
});

/** The study whose invitations are shown. */
let recruiting = "";

/** @param {string} token */
const linkOf = (token) => new URL(`study/${encodeURIComponent(recruiting)}?invitation=${token}`, document.baseURI).href;

/** @param {string[]} links */
function showLinks(links) {
  const place = by("links", HTMLTextAreaElement);
  place.value = links.join("\n");
  place.rows = Math.min(8, links.length);
  by("new-links").hidden = links.length === 0;
  if (links.length) place.focus();
  place.select();
}
by("invite").addEventListener("submit", (event) => {
  event.preventDefault();
  const count = Number(by("invite-count", HTMLInputElement).value);
  run(async () => {
    /** @type {{tokens: string[]}} */
    const { tokens } = await request(ofStudy("invitations"), { count });
    showLinks(tokens.map(linkOf));
  });
});
by("invitations").addEventListener("click", (event) => {
  const button = /** @type {Element} */ (event.target).closest("button");
  const id = button?.dataset.id ?? "";
  if (button?.dataset.act === "link") showLinks([linkOf(button.dataset.token ?? "")]);
  if (button?.dataset.act === "revoke") run(() => request(ofStudy("invitations/revoke"), { ids: [id] }));
});

/** @param {Admin.Invitation} invitation @param {number} now_ms */
function invitationRow({ id, state, issued_ms: issued, revoked_ms: revoked, label, at_ms: at, token }, now_ms) {
  const since = state === "revoked" ? revoked : at ?? issued;
  const buttons = token === null ? [] : [
    create("button", "Link", { type: "button", class: "quiet", "data-act": "link", "data-token": token, "aria-label": `Show the link of ${id}` }),
    create("button", "Revoke", { type: "button", class: "quiet danger", "data-act": "revoke", "data-id": id, "aria-label": `Revoke ${id}` })];
  const cells = [create("th", id, { scope: "row" }), create("td", state), create("td", label ?? ""), create("td", ago(now_ms - (since ?? issued)), { class: "number" }), create("td", buttons)];
  return create("tr", cells, { "data-testid": `invitation-${id}`, "data-state": state });
}

/** @param {Admin.ConsoleStudy} shown */
function paintRecruiting(shown) {
  if (recruiting !== shown.name) showLinks([]);
  recruiting = shown.name;
  const { recruitment, code, code_until_ms: until, invitations, status, now_ms } = shown;
  put(by("recruitment"), RECRUITMENT[recruitment]);
  by("code-line").hidden = code === null;
  put(by("code"), code ?? "");
  put(by("code-until"), until === null ? "" : `until ${new Date(until).toISOString().slice(0, 10)}, 00:00 UTC`);
  by("invitations-part").hidden = recruitment !== "invitation";
  by("invite").hidden = status !== "open";
  put(by("invitation-counts"), invitations.length ? `${many(invitations.length, "invitation")}: ${invitationCounts(invitations)}.` : "Nobody has been invited yet.");
  const table = by("invitations", HTMLTableElement);
  const key = JSON.stringify([shown.name, invitations.map(({ id, state, label, token }) => [id, state, label, token]), Math.floor(now_ms / 60000)]);
  if (table.dataset.shown === key) return; // a button in focus stays the same button
  table.dataset.shown = key;
  table.tBodies[0].replaceChildren(...invitations.map((each) => invitationRow(each, now_ms)));
}

load();
