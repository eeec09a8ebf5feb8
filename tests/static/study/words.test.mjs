import assert from "node:assert/strict";
import test from "node:test";
import { taskOf } from "../../../static/task/mars/index.js";
import { MARS } from "../task/mars/about.mjs";
import * as words from "../../../static/study/words.js";

const frame = (changes = {}) => ({ kind: "frame", episode: "e1", step: 0, rows: 2, cols: 3, grid: ["@.?", "#??"], position: [0, 0],
  discovered: 3, coverage: 0.5, heading: "east", reward: null, return: null, score: null, outcome: null, ...changes });
const about = (changes = {}) => ({ session: "s1", player: "human", level: "random", size: [2, 3], counts: false, rival: null, frame: frame(changes) });
const task = taskOf(MARS);
const { announcement } = task;
const participant = (changes = {}) => ({ task, study: "demo", title: "Demo", participant: "P-1", stage: "ranked", consent: { version: "1", text: "a\n\nb" }, questions: [],
  right: null, warm_up: { done: 1, of: 1 }, ranked: { done: 0, of: 2 }, tutorial: { done: true }, break_due: false, can_be_erased: true, pause_after_s: 60, rules: { coverage: "96.5 %", lidar_radius: "4", max_steps: "63" }, session: null, about: null,
  phase: null, settings: {}, debrief: null, practice: null, ...changes });

test("no sentence of a ranked terrain contains a score", () => {
  const { figures, next } = words.endCard(frame({ outcome: "explored", step: 30 }), participant({ phase: "ranked" }));
  assert.deepEqual(figures.map(([name]) => name), ["Moves", "Mapped"]);
  assert.equal(next, "Next terrain");
  assert.deepEqual(words.endCard(frame({ outcome: "explored", score: 0.9 }), participant({ phase: "warm_up", stage: "warm_up" })).figures.at(-1), ["Score", "0.900"]);
  assert.equal(words.endCard(frame({ outcome: "explored" }), participant({ phase: "ranked", break_due: true })).next, "Go on");
});

test("no announcement of a ranked terrain contains a score", () => {
  assert.doesNotMatch(announcement(frame({ coverage: 0.4 }), frame({ coverage: 0.6, step: 9 })), /score/i);
  assert.doesNotMatch(announcement(frame(), frame({ outcome: "explored", step: 9 })), /score/i);
  assert.match(announcement(frame(), frame({ outcome: "explored", step: 9, score: 0.9 })), /Score 0.900/);
});

test("progress counts the running terrain, and the share of the whole study ends at one", () => {
  assert.equal(words.progress(participant(), true), "Ranked: terrain 1 of 2");
  assert.equal(words.progress(participant({ ranked: { done: 2, of: 2 } }), true), "Ranked: terrain 2 of 2");
  assert.equal(words.progress(participant({ stage: "debrief" }), false), "Debrief");
  assert.equal(words.share(participant({ stage: "complete", ranked: { done: 2, of: 2 } })), 1);
});

test("the page's own sentences name the numbers of the protocol", () => {
  const explored = words.endCard(frame({ outcome: "explored", score: 0.9 }), participant({ phase: "warm_up", stage: "warm_up" }));
  assert.deepEqual([explored.line, explored.note], ["96.5 % of the terrain is on the map.", "Fewer moves to 96.5 % are better. This one does not count."]);
  const two = { questions: [{ question: "?", choices: [] }, { question: "?", choices: [] }] };
  assert.equal(words.progress(participant({ stage: "questions", ...two }), false), "Two questions");
  assert.equal(words.endCard(frame({ outcome: "explored" }), participant({ phase: "tutorial", stage: "tutorial", ...two })).next, "Go on to two questions");
  assert.equal(words.endCard(frame({ outcome: "explored" }), participant({ phase: "tutorial", stage: "tutorial" })).next, "Go on");
});

test("another try at the practice is named, and does not begin at once", () => {
  const practice = { text: "You pass if you do.", number: 2, tries: 3 };
  const again = participant({ stage: "warm_up", phase: "warm_up", warm_up: { done: 0, of: 2 }, practice });
  assert.equal(words.progress(again, true), "Warm-up, try 2 of 3: terrain 1 of 2");
  const { title, lines, go } = words.readyText(again);
  assert.deepEqual([title, lines[0], lines.at(-1), go], ["Warm-up, try 2 of 3", "The practice is not passed yet.", "You pass if you do.", "Start this try"]);
  assert.equal(words.endCard(frame({ outcome: "abandoned", score: 0.1 }), again).next, "Go on");
  const first = participant({ stage: "warm_up", warm_up: { done: 0, of: 2 }, practice: { ...practice, number: 1 } });
  assert.equal(words.readyText(first).go, "Start the warm-up");
});
