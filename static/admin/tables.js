// Stages, figure, participants, health: elements made from what the server says.
import { create } from "../common/page.js";
import { many, score } from "../common/words.js";
import { ago, endings, flags, place, size, stageName } from "./words.js";

/** Unfold a part once something in it is wrong: who folds it again is left alone until something else is.
 * @param {HTMLElement} part @param {string} faults that stand in it, in words; empty without any */
export function unfold(part, faults) {
  if (faults && part.dataset.faults !== faults) part.setAttribute("open", "");
  part.dataset.faults = faults;
}

/** @param {HTMLTableElement} table @param {Admin.ConsoleStudy["stages"]} stages */
export function paintStages(table, stages) {
  const most = Math.max(1, ...stages.map(({ human, script }) => human + script));
  table.tBodies[0].replaceChildren(...stages.map(({ stage, human, script }) => {
    const bars = [human, script].map((count) => create("i", [], { style: `width: ${(100 * count) / most}%` }));
    const track = create("div", bars, { class: "track" });
    const cells = [create("th", stageName(stage), { scope: "row" }), create("td", track), create("td", String(human), { class: "number" }), create("td", String(script), { class: "number" })];
    return create("tr", cells, { "data-testid": `stage-${stage}`, "data-empty": String(human + script === 0) });
  }));
}

/** @param {HTMLElement} where @param {HTMLElement} words @param {Task} task @param {Admin.ConsoleStudy} study */
export function paintFigure(where, words, { target }, { figure, max_steps: limit }) {
  words.textContent = figure?.players ? figure.sentence : "";
  if (!figure?.players || !figure.steps || !figure.score) {
    const why = figure?.sentence ?? "Nobody has joined yet, so there is no figure.";
    where.replaceChildren(create("p", why, { class: "empty" }));
    return;
  }
  where.replaceChildren(measure(`Moves to ${target}`, figure.steps, (value) => value.toFixed(1), 0, limit), measure("Score", figure.score, score, 0, 1));
}

/** @param {string} name @param {Answers.Interval} value @param {(value: number) => string} text @param {number} low
 * @param {number} high */
function measure(name, value, text, low, high) {
  const interval = value.low === null || value.high === null ? "no interval yet" : `${text(value.low)} to ${text(value.high)}`;
  const span = create("div", [], { class: "span", "aria-hidden": "true" });
  if (value.low !== null && value.high !== null) {
    const [from, to] = [place(value.low, low, high), place(value.high, low, high)];
    span.append(create("i", [], { style: `left: ${from}%; width: ${to - from}%` }));
  }
  span.append(create("b", [], { style: `left: ${place(value.mean, low, high)}%` }));
  return create("div", [create("dl", [create("dt", name), create("dd", [text(value.mean), create("small", interval)])]), span], { class: "measure" });
}

/** What stands in a cell without a figure. */
const NOTHING = "\u2013";

/** @param {HTMLTableElement} table @param {Task} task @param {Admin.ConsoleStudy} study */
export function paintPeople(table, task, study) {
  const rows = study.participants.map((person) => {
    const kind = person.kind === "script" ? [create("span", `script: ${person.script ?? ""}`, { class: "kind" })] : [];
    if (person.arm !== null) kind.push(create("span", `arm ${person.arm}`, { class: "kind" }));
    const { ranked, warm_up: warmUp } = person;
    /** @type {Node[]} */
    const bar = ranked === null ? [] : [create("progress", [], { max: String(study.ranked), value: String(ranked), "aria-label": `Ranked episodes of ${person.label}` })];
    const progress = person.stage === "warm_up" ? `warm-up ${warmUp} of ${study.warm_up}` : ranked === null ? NOTHING : `${ranked} of ${study.ranked}`;
    const number = (/** @type {string} */ text, /** @type {string} */ name) => create("td", text, { class: text === NOTHING ? "number absent" : "number", "data-name": name });
    const means = [number(person.mean_steps?.toFixed(1) ?? NOTHING, `moves to ${task.target}`), number(person.mean_score === null ? NOTHING : score(person.mean_score), "score")];
    const cells = [create("th", [person.label, ...kind], { scope: "row" }), create("td", stageName(person.stage)), create("td", [...bar, progress], progress === NOTHING ? { class: "absent" } : {}), ...means,
      create("td", endings(task, person.outcomes)), create("td", flags(person, study.labels), { class: "flags" }), number(String(person.connections), "connections"), number(`${person.minutes} min`, "in all")];
    return create("tr", cells, { "data-testid": `person-${person.label}`, "data-stage": person.stage });
  });
  if (rows.length === 0) rows.push(create("tr", create("td", "Nobody has joined yet.", { colspan: "9" })));
  table.tBodies[0].replaceChildren(...rows);
}

/** @param {HTMLElement} list @param {{text: string, detail: string, isWarning: boolean}[]} found */
export function paintAttention(list, found) {
  const items = found.map(({ text, detail, isWarning }) => create("li", [text, create("span", detail)], { "data-tone": isWarning ? "warn" : "note" }));
  list.replaceChildren(...(items.length ? items : [create("li", "Nothing unusual: nobody has left or gone quiet, no episode carries a label.")]));
}

/** @param {HTMLElement} list @param {import("./words.js").Glance[]} facts */
export function paintGlance(list, facts) {
  list.replaceChildren(...facts.map(({ name, number, detail, isWarning }) => create("div", [
    create("dt", name), create("dd", [create("b", number, { "data-tone": isWarning ? "warn" : "" }), create("span", detail)])], { class: "panel" })));
}

/** @param {HTMLElement} list @param {Admin.ServerHealth} health @param {number} now_ms */
export function paintHealth(list, health, now_ms) {
  const { disk, database, check, chain, owners, watched } = health;
  const stored = owners.map(({ kind, name, bytes, budget }) => `${kind === "study" ? `study ${name}` : kind === "player" ? "a browser" : "a network"} ${size(bytes)} of ${size(budget)}`);
  const age = watched.backup_age_seconds;
  /** @type {[string, string, string][]} */
  const facts = [
    ["Disk", `${size(disk.free)} free of ${size(disk.total)}`, disk.is_low ? "warn" : ""],
    ["Database", `${database.name}, ${size(database.size)}, and ${size(database.wal_size)} waiting in its log`, ""],
    ["Stored today, or charged to open boards", stored.join(", ") || "nothing", owners.some(({ bytes, budget }) => bytes > 0.8 * budget) ? "warn" : ""],
    ["Newest backup", age < 0 ? "none is made (--backup-every)" : `verified ${ago(1000 * age)}`, age > 86400 || watched.backup_failures ? "warn" : ""],
    ["Moves", watched.move_p99_seconds ? `99 of 100 took at most ${Math.round(1000 * watched.move_p99_seconds)} ms` : "none since the start", watched.move_p99_seconds > 0.1 ? "warn" : ""],
    ["Waiting", `${many(watched.waiting_jobs, "job")}, ${many(watched.waiting_writes, "write")}`, watched.waiting_jobs > 20 || watched.waiting_writes > 100 ? "warn" : ""],
    ["Last write", ago(now_ms - health.last_write_ms), ""],
    ["Integrity", !check ? "is being checked" : check.is_whole ? `no damage found, ${ago(now_ms - check.at_ms)}` : check.result, !check ? "" : check.is_whole ? "good" : "warn"],
    ["Chain", chain ? `${many(chain.entries, "entry", "entries")}${chain.head && `, head ${chain.head}`}` : "cannot be read", chain ? "" : "warn"],
    ["Server", `${many(health.sessions, "board")} in memory, up for ${ago(1000 * health.up_s + 10000).replace(" ago", "")}`, ""],
  ];
  list.replaceChildren(...facts.flatMap(([name, text, tone]) => [create("dt", name), create("dd", text, { "data-tone": tone })]));
}

/** @param {HTMLElement} place @param {string} text @param {Admin.Export | null} state @param {string} study */
export function paintExport(place, text, state, study) {
  const key = JSON.stringify([text, state?.files]);
  if (place.dataset.shown === key) return; // a link in focus stays the same link
  place.dataset.shown = key;
  place.dataset.state = state?.state ?? "none";
  const links = (state?.files ?? []).map(({ name, size: bytes }) => {
    const href = `api/admin/studies/${encodeURIComponent(study)}/files/${encodeURIComponent(name)}`;
    return create("a", `${name} (${size(bytes)})`, { href, download: name });
  });
  place.replaceChildren(`${text} `, ...links);
}

/** @param {HTMLElement} list @param {Admin.Overview} overview */
export function paintFailures(list, { failures, now_ms }) {
  /** @type {HTMLElement} */ (list.closest("section")).hidden = failures.length === 0;
  const key = JSON.stringify(failures);
  if (list.dataset.shown === key) return; // one that is read stays open
  list.dataset.shown = key;
  list.replaceChildren(...failures.map(({ episode, ended_ms: at_ms, seed, report }) => {
    const [line, ...trace] = report.split("\n");
    const place = at_ms === null ? "seed, step and time are hidden while its study's secret is kept" : `seed ${seed}, ${ago(now_ms - at_ms)}`;
    return create("details", [create("summary", line), create("p", `Episode ${episode}: ${place}`, { class: "fine" }), create("pre", trace.join("\n"), { tabindex: "0" })]);
  }));
}

/** @param {HTMLTableElement} table @param {Admin.Overview} overview @param {(name: string, hidden: boolean) => void} onHide */
export function paintNames(table, { names, now_ms }, onHide) {
  const key = JSON.stringify(names);
  if (table.dataset.shown === key) return; // a button in focus stays the same button
  table.dataset.shown = key;
  const rows = names.map(({ name, chosen_ms: at_ms, hidden }) => {
    const button = create("button", hidden ? "Show again" : "Hide", { type: "button", class: "quiet", "aria-label": `${hidden ? "Show" : "Hide"} ${name}` });
    button.addEventListener("click", () => onHide(name, !hidden));
    return create("tr", [create("th", name, { scope: "row" }), create("td", ago(now_ms - at_ms)), create("td", button, { class: "number" })]);
  });
  table.tBodies[0].replaceChildren(...(rows.length ? rows : [create("tr", create("td", "Nobody has chosen one yet.", { colspan: "3" }))]));
}
