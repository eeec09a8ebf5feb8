// The operator's console in words, and boards as their messages come, without a page.
import assert from "node:assert/strict";
import { test } from "node:test";
import { taskOf } from "../../../static/task/mars/index.js";
import { MARS } from "../task/mars/about.mjs";
import { boardAfter, caption } from "../../../static/admin/live.js";
import { unfold } from "../../../static/admin/tables.js";
import { ago, attention, endings, exportText, flags, glance, invitationCounts, place, size, summary } from "../../../static/admin/words.js";

const person = (label, rest = {}) => ({ id: label, label, kind: "human", script: null, stage: "ranked", joined_ms: 0, minutes: 0, is_quiet: false, left_at: null, asks_erasure: false, deviations: 0,
  warm_up: 0, ranked: 0, mean_score: null, mean_steps: null, outcomes: {}, repeated: [], not_attested: [], invitation: null, supervised_ms: null, ...rest });
const study = (rest = {}) => ({ name: "dunes", title: "Dunes", status: "open", frozen_ms: Date.UTC(2026, 10, 2), closed_ms: null, level: "random", rows: 21, cols: 21, max_steps: 441,
  planned: 10, cap: null, places_taken: 0, warm_up: 15, ranked: 30, stages: [], participants: [], figure: null, labels: [], exports: { report: null, release: null }, now_ms: 0, ...rest });
const well = { disk: { free: 5e10, total: 1e11, is_low: false }, database: {}, check: { is_whole: true, result: "ok" } };

test("times and sizes are short", () => {
  assert.deepEqual([0, 42_000, 150_000, 7_200_000, 200_000_000].map(ago), ["now", "42 s ago", "2 min ago", "2 h ago", "2 d ago"]);
  assert.deepEqual([512, 4096, 680_000, 72_100_000_000].map(size), ["512 B", "4.1 kB", "680 kB", "72.1 GB"]);
});

test("people and scripts are counted apart", () => {
  assert.match(summary(study()), /Open since 2026-11-02: nobody of 10 planned has joined yet\.$/);
  const participants = [person("A", { stage: "complete" }), person("B"), person("S", { kind: "script", script: "random" })];
  assert.match(summary(study({ participants })), /2 people of 10 planned, 1 through, and 1 script outside of every human score\.$/);
});

test("what needs attention: damage and silence first, labels after, nothing of scripts", () => {
  assert.deepEqual(attention(study(), well), []);
  assert.deepEqual(attention(study(), { ...well, check: null }), [], "the first check is under way");
  const participants = [person("A", { stage: "withdrawn", left_at: "warm_up" }), person("B", { is_quiet: true }), person("C", { deviations: 1 }),
    person("S", { kind: "script", is_quiet: true, deviations: 3, stage: "withdrawn" })];
  const labels = [{ label: "no key-up", episodes: 2, participants: ["C"] }];
  const found = attention(study({ participants, labels }), { ...well, check: { is_whole: false, result: "page 7 is torn" } });
  assert.deepEqual(found.map(({ text, isWarning }) => [text, isWarning]), [["The database is damaged", true], ["1 person without a sign for half an hour", true],
    ["1 person with a deviation", true], ["1 person left the study", false], ["\u201cno key-up\u201d on 2 episodes", false]]);
  assert.equal(found[3].detail, "1 at warm-up");
  assert.equal(flags(participants[2], labels), "deviation, no key-up");
});

test("recruitment, quality, payments and the disk stand first", () => {
  const participants = [person("A", { stage: "complete" }), person("B", { is_quiet: true }), person("C", { stage: "consent" }), person("S", { kind: "script", stage: "complete" })];
  const labels = [{ label: "no key-up", episodes: 2, participants: ["B"] }];
  const outcomes = [{ outcome: "finished", words: "", text: "CODE" }, { outcome: "left", words: "", text: "" }];
  const invitations = [{ state: "issued" }, { state: "used" }];
  const facts = glance(study({ participants, labels, outcomes, invitations }), { ...well, watched: { backup_age_seconds: 7200 } });
  assert.deepEqual(facts.map(({ number, detail, isWarning }) => [number, detail, isWarning]), [
    ["1 of 10", "have played all; 3 people have come, 1 link not opened", false], ["1", "warning below; 2 flags on episodes", true],
    ["2", "agreed to take part; 1 outcome has no text yet", false], ["50.0 GB", "free; backup 2 h ago", false]]);
  const turned = [person("D", { stage: "withdrawn", left_at: "consent" })];
  const full = glance(study({ cap: 12, places_taken: 12, participants: [...participants, ...turned], labels, outcomes, invitations }), { ...well, watched: { backup_age_seconds: 7200 } });
  assert.deepEqual(full.slice(0, 3).map(({ detail }) => detail), ["have played all; 4 people have come, 12 of 12 places taken, 1 link not opened", "warning below; 2 flags on episodes", "agreed to take part; 1 outcome has no text yet"]);
  assert.equal(full[2].number, "2", "whoever did not agree is none of those to pay");
});

test("signs of taking part twice are told apart from ids that are missing", () => {
  const participants = [person("A", { repeated: ["no outside id"] }), person("B", { repeated: ["their invitation was opened again elsewhere"], supervised_ms: 5 })];
  const found = attention(study({ participants }), well);
  assert.deepEqual(found.map(({ text, detail, isWarning }) => [text, detail, isWarning]), [["1 person with a sign of taking part twice", "B", true], ["1 person without an outside id", "A", false]]);
  assert.equal(flags(person("C", { is_quiet: true }), []), "no sign for half an hour");
  assert.equal(flags(participants[1], []), "supervised, their invitation was opened again elsewhere");
});

test("invitations are counted by their state", () => {
  assert.equal(invitationCounts([]), "");
  assert.equal(invitationCounts([{ state: "used" }, { state: "issued" }, { state: "issued" }, { state: "opened" }]), "2 not opened yet, 1 opened, not agreed to yet, 1 used");
});

test("endings, places and exports in words", () => {
  assert.equal(endings(taskOf(MARS), { collided: 1, explored: 4 }), "4 mapped, 1 collided");
  assert.deepEqual([place(0, 0, 2), place(1, 0, 2), place(9, 0, 2)], [0, 50, 100]);
  assert.equal(exportText(null, "Not yet.", 0), "Not yet.");
  assert.equal(exportText({ state: "failed", began_ms: 0, error: "no room", files: [] }, "", 0), "Not made: no room");
});

test("a watched board keeps its path, begins anew with an episode, and heals by a history", () => {
  const frame = (episode, step, position) => ({ kind: "frame", episode, step, position, discovered: 1, cells: 4 });
  const task = taskOf(MARS);
  let board = boardAfter(task, null, frame("a", 0, [0, 0]));
  board = boardAfter(task, board, frame("a", 1, [0, 1]));
  assert.deepEqual(board.trail, [[0, 0], [0, 1]]);
  board = boardAfter(task, board, frame("a", 4, [1, 3]));
  assert.deepEqual(board.trail.length, 2, "steps are missing");
  board = boardAfter(task, board, { kind: "history", episode: "a", positions: [[0, 0], [0, 1], [0, 2], [0, 3], [1, 3]], discovered: [1, 1, 1, 1, 1] });
  assert.equal(board.trail.length, 5);
  assert.deepEqual(boardAfter(task, board, frame("b", 0, [0, 0])).trail, [[0, 0]]);
  assert.deepEqual(caption({ label: "AB12", kind: "script", phase: "ranked", trial: 4 }), ["AB12 (script)", "Ranked 5"]);
  assert.deepEqual(caption({ label: null, kind: "human", phase: null, trial: null }), ["a player", "playground"]);
});

test("a part unfolds for a fault, and once folded only for another one", () => {
  const opened = [], part = { dataset: {}, setAttribute: (name) => opened.push(name) };
  for (const faults of ["", "Disk", "Disk", "Disk, Chain", "", "Disk"]) unfold(part, faults);
  assert.equal(opened.length, 3, "Disk, then Chain beside it, then Disk again");
});
