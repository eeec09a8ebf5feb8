import assert from "node:assert/strict";
import test from "node:test";
import { readDetail } from "../../static/common/api.js";
import { cellSize, runs } from "../../static/common/board.js";
import { axisEnd, sampled, tickStep } from "../../static/common/chart_scale.js";
import { sessionInHash, sessionWish } from "../../static/play/sessions.js";
import { socketUrl } from "../../static/common/connections.js";
import { favourite, MAX_SEED, readWish } from "../../static/play/terrain_dialog.js";
import { backoff_ms } from "../../static/common/socket.js";
import { viewerUrl } from "../../static/play/views.js";
import * as words from "../../static/common/words.js";

const frame = (changes = {}) => ({ episode: "e", step: 60, rows: 3, cols: 4, grid: ["@.?#", "#.??", "????"], position: [0, 0], coverage: 0.5,
  score: 0.9, outcome: null, ...changes });

test("coverage never reads 99.0 before 99 % are known", () => {
  assert.equal(words.percent(0.98999), "98.9");
  assert.equal(words.percent(0.99), "99.0");
  assert.equal(words.percent(1), "100.0");
});

test("the comparison says who needed fewer moves", () => {
  const mine = frame({ outcome: "explored" });
  assert.equal(words.compare(mine, frame({ outcome: "explored", step: 70 }), "ppo"), "You needed 10 moves fewer than ppo (70, score 0.900).");
  assert.equal(words.compare(mine, frame({ outcome: "explored", step: 59 }), "ppo"), "You needed 1 move more than ppo (59, score 0.900).");
  assert.equal(words.compare(mine, frame({ outcome: "explored" }), "ppo"), "You and ppo both needed 60 moves.");
  assert.match(words.compare(mine, frame(), "ppo"), /still exploring: 60 moves, 50.0 %/);
  assert.match(words.compare(mine, frame({ outcome: "timed_out" }), "ppo"), /did not reach 99 %: out of moves/);
  assert.equal(words.compare(mine, null, "ppo"), "");
});

test("only an explored terrain has steps to 99 %", () => {
  assert.equal(words.stepsToGoal(frame({ outcome: "explored" })), 60);
  assert.equal(words.stepsToGoal(frame({ outcome: "timed_out" })), null);
});

test("the matrix in words tells the four neighbours, edges too", () => {
  const said = words.describeBoard(frame(), "You");
  assert.match(said, /3 rows, 4 columns/);
  assert.match(said, /north edge, east free, south obstacle, west edge/);
});

test("a screen reader hears tenths, endings and new terrains, not every step", () => {
  assert.equal(words.announcement(frame({ coverage: 0.41 }), frame({ coverage: 0.44 })), "");
  assert.match(words.announcement(frame({ coverage: 0.39 }), frame({ coverage: 0.44 })), /^40 percent/);
  assert.match(words.announcement(frame(), frame({ outcome: "collided" })), /score 0.900/);
  assert.match(words.announcement(null, frame()), /^New terrain/);
});

test("a filled sheet is a wish, a wrong one a sentence", () => {
  const fields = { level: "1-1-1", side: "42", rows: "9", cols: "11", seed: " ", rival: "ppo", player: "random" };
  assert.deepEqual(readWish(fields), { level: "1-1-1", size: 42, seed: null, rival: "ppo", player: "random" });
  assert.deepEqual(readWish({ ...fields, side: "custom", seed: "7" }).size, [9, 11]);
  assert.equal(readWish({ ...fields, seed: String(MAX_SEED) }).seed, MAX_SEED);
  for (const wrong of [{ side: "custom", rows: "4" }, { side: "custom", cols: "129" }, { side: "custom", rows: "5.5" }, { seed: "-1" },
    { seed: "9007199254740993" }, { seed: "0x1" }]) assert.equal(typeof readWish({ ...fields, ...wrong }), "string");
});

test("each mode asks for its own kind of session", () => {
  const wish = { level: "random", size: 21, seed: null, rival: "ppo", player: "random" };
  assert.deepEqual(sessionWish("practice", wish), { level: "random", size: 21, player: "human", rival: "ppo" });
  assert.deepEqual(sessionWish("ranked", wish), { level: "random", size: 21, player: "human" });
  assert.deepEqual(sessionWish("watch", { ...wish, seed: 0 }), { level: "random", size: 21, seed: 0, player: "random", rival: "ppo" });
});

test("the default rival is the trained one, else the best rule", () => {
  assert.equal(favourite(["random", "ppo-21", "frontier-utility"]), "ppo-21");
  assert.equal(favourite(["random", "frontier-utility", "planner"]), "frontier-utility");
  assert.equal(favourite([]), "");
});

test("a session stands in the address", () => {
  assert.equal(sessionInHash("#s=ab_c-1234"), "ab_c-1234");
  assert.equal(sessionInHash("#s=<script>"), null);
  assert.equal(sessionInHash(""), null);
});

test("the socket keeps scheme and prefix of the page", () => {
  assert.equal(socketUrl("abc", "https://host/lab/mars/?x=1#s=abc"), "wss://host/lab/mars/ws/sessions/abc");
  assert.equal(socketUrl("abc", "http://127.0.0.1:8000/"), "ws://127.0.0.1:8000/ws/sessions/abc");
});

test("attempts to reconnect grow apart, to five seconds", () => {
  assert.deepEqual([0, 1, 2, 9].map(backoff_ms), [250, 500, 1000, 5000]);
});

test("whatever FastAPI says becomes one sentence", () => {
  assert.equal(readDetail("rows must be at least 5, got 3", 422), "rows must be at least 5, got 3");
  assert.equal(readDetail([{ loc: ["body", "size"], msg: "is wrong" }], 422), "size is wrong");
  assert.equal(readDetail(undefined, 502), "The server answered 502.");
});

test("cells are whole device pixels, and a row paints in runs", () => {
  assert.equal(cellSize(200, 400, 21, 21, 1), 9);
  assert.equal(cellSize(200, 100, 5, 7, 2), 40);
  assert.equal(cellSize(0, 0, 5, 7, 1), 1);
  assert.deepEqual(runs("??.#"), [[0, 2, "?"], [2, 1, "."], [3, 1, "#"]]);
});

test("the step axis grows in round numbers and keeps few labels", () => {
  assert.equal(axisEnd(0), 40);
  assert.equal(axisEnd(60), 80);
  assert.equal(axisEnd(441), 500);
  for (const steps of [0, 60, 441, 7056, 16384]) assert.ok(axisEnd(steps) > steps && axisEnd(steps) / tickStep(axisEnd(steps)) <= 8);
});

test("a long curve is thinned, its last point kept", () => {
  assert.deepEqual(sampled(3, 10), [0, 1, 2]);
  assert.equal(sampled(7057, 600).at(-1), 7056);
  assert.ok(sampled(7057, 600).length <= 601);
  assert.deepEqual(sampled(0, 10), []);
});

test("an empty seat says whether the episode counts and what follows", () => {
  assert.equal(words.emptyBoardText({ player: null, counts: false }, ""), "Preparing a terrain.");
  assert.match(words.emptyBoardText({ player: {}, counts: true }, "ppo"), /^This episode counts .* ppo explores/);
  assert.match(words.emptyBoardText({ player: {}, counts: false }, ""), /does not count .* a policy explores/);
});

test("the human level of a configuration is one short line", () => {
  assert.equal(words.figure({ score: { mean: 0.9391 }, steps: { mean: 81.23 } }), "81.2 steps \u00b7 score 0.939");
});

test("the 3-D view is asked for beside the page, in coarser pixels where the processor draws", () => {
  assert.equal(viewerUrl("ab_c", false), "viewer/ab_c/");
  assert.equal(viewerUrl("ab_c", true), "viewer/ab_c/?fixedDpr=0.75&software-canvas");
});
