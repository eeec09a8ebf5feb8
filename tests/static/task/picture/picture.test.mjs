// An environment that is shown as its own picture: what a page says of its frames.
import assert from "node:assert/strict";
import test from "node:test";
import { apply, initialState } from "../../../../static/common/game_state.js";
import { taskOf } from "../../../../static/task/picture/index.js";

const task = taskOf({ name: "gymnasium", title: "FrozenLake-v1", assets: "picture", actions: ["left", "down", "right", "up"],
  keys: { left: ["ArrowLeft", "KeyA"], down: ["ArrowDown", "KeyS"], right: ["ArrowRight", "KeyD"], up: ["ArrowUp", "KeyW"] },
  metrics: [{ name: "return", unit: "", lowest: 0, highest: 1, is_better: "higher" }] });
const frame = (changes = {}) => ({ kind: "frame", episode: "e1", step: 0, reward: 0, return: 0, score: null, outcome: null, picture: "data:,",
  text: "SFFF\nFHFH", headline: 0, ...changes });

test("a frame is told by its text, its headline and its outcome", () => {
  assert.deepEqual(task.inWords(frame({ step: 1 }), "You"), { line: "SFFF; FHFH; running after 1 move", rows: ["SFFF", "FHFH"] });
  assert.deepEqual(task.headline(frame({ headline: 1 })), { value: "1", unit: "return", share: 1 });
  assert.equal(task.ending(frame({ step: 6, outcome: "timed_out" })).title, "Timed out after 6 moves");
  const failed = task.ending(frame({ step: 6, outcome: "environment_failed" }));
  assert.deepEqual([failed.title, /not your doing/.test(failed.line)], ["Environment failed after 6 moves", true]);
  assert.deepEqual(task.trialEnding(frame({ outcome: "success", headline: 1 }), "").figures, [["Moves", "0"], ["return", "1"]]);
  assert.equal(task.announcement(frame(), frame({ step: 1, text: null })), "");
  assert.equal(task.announcement(frame(), frame({ step: 6, outcome: "success" })), "Success after 6 moves.");
});

test("the page's state follows frames of any task", () => {
  const about = { task, session: "s1", player: "human", level: "", map: null, size: 0, counts: true, rival: null, frame: frame() };
  const state = apply(apply(initialState(), { kind: "begun", about }), { kind: "received", role: "player", message: frame({ step: 1, headline: 1 }) });
  assert.deepEqual(state.player.progress, [0, 1]);
  assert.equal(state.player.hasGap, false);
});

test("the axis spans what a metric can come to, or what it has come to", () => {
  assert.deepEqual([task.chart.axis(200, [0, 1]).low, task.chart.axis(200, [0, 1]).high], [0, 1]);
  const free = taskOf({ ...task, metrics: [{ name: "return", unit: "points", lowest: null, highest: null, is_better: "higher" }] });
  assert.deepEqual([free.chart.axis(200, [-3, 9]).low, free.chart.axis(200, [-3, 9]).high, free.chart.say(9)], [-3, 9, "9 points"]);
});

test("a replay stands at the newest frame that is not after its move", () => {
  const course = task.courseOf("You", [frame(), frame({ step: 2, headline: 0.5 }), frame({ step: 3, headline: 1, outcome: "success" })]);
  assert.deepEqual([0, 1, 2, 9].map((step) => task.boardAt(course, step).frame.step), [0, 0, 2, 3]);
  assert.deepEqual([course.actions.length, course.outcome, task.progressAt(course, 9)], [3, "success", 1]);
  assert.equal(task.courseOf("You", []), null);
});
