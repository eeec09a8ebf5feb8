import assert from "node:assert/strict";
import test from "node:test";
import { taskOf } from "../../../static/task/mars/index.js";
import { MARS } from "../task/mars/about.mjs";
import { apply, ghostOf, initialState, isDriven, isPractice, withFrame } from "../../../static/common/game_state.js";

/** @param {object} [changes] */
export const frame = (changes = {}) => ({ kind: "frame", episode: "e1", step: 0, rows: 2, cols: 3, grid: ["@.?", "#??"], position: [0, 0],
  discovered: 3, cells: 6, coverage: 0.5, heading: "east", reward: 0, return: 0, score: 0.4, outcome: null, ...changes });
const task = taskOf(MARS);
const about = (changes = {}) => ({ task, session: "s1", kind: "practice", challenges: null, player: "human", level: "random", size: [2, 3], counts: false, frame: frame(),
  rival: { session: "r1", policy: "frontier-cost", pace: { kind: "pace", mode: "follow", moves_per_second: 4 }, frame: frame({ episode: "x" }) }, ...changes });
const begun = (changes) => apply(initialState(), { kind: "begun", about: about(changes) });
const receive = (state, message, role = "player") => apply(state, { kind: "received", role, message });

test("a session with a policy fills both boards", () => {
  const state = begun();
  assert.equal(state.mode, "practice");
  assert.equal(state.player.name, "You");
  assert.equal(state.rival.name, "frontier-cost");
  assert.equal(state.rival.pace.mode, "follow");
  assert.deepEqual(state.player.trail, [[0, 0]]);
});

test("another session is connecting until its own socket is open", () => {
  const open = apply(begun(), { kind: "link", link: "open" });
  assert.equal(begun().link, "connecting");
  assert.equal(apply(open, { kind: "begun", about: about({ frame: frame({ episode: "e2" }) }) }).link, "open");
  assert.equal(apply(open, { kind: "begun", about: about({ session: "s2" }) }).link, "connecting");
});

test("what is played is what the server says, whoever plays and whatever is beside it", () => {
  const kinds = { ranked: [true, false], practice: [true, true], challenge: [true, true], daily: [true, false], watch: [false, false] };
  for (const [kind, [driven, practice]] of Object.entries(kinds)) {
    const states = [{ rival: null }, {}, { player: "ppo" }].map((changes) => begun({ kind, ...changes }));
    assert.deepEqual(states.map(({ mode }) => mode), [kind, kind, kind]);
    assert.deepEqual([isDriven(states[0]), isPractice(states[0])], [driven, practice]);
  }
});

test("a challenge has its opponent beside it, as far as the player", () => {
  const run = { name: "A person", actions: ["east", "east"] };
  const stub = { ...task, boardAt: (course, step) => ({ frame: frame({ episode: "theirs", step }), trail: [[0, 0]] }), progressAt: () => 0.5 };
  const state = apply(begun({ task: stub, kind: "challenge", challenges: "e0", rival: null }), { kind: "challenged", opponent: { episode: "e1", course: run } });
  assert.deepEqual([state.mode, state.challenges, state.rival.name, state.rival.frame.step], ["challenge", "e0", "A person", 0]);
  const moved = receive(state, frame({ step: 1, position: [0, 1] }));
  assert.deepEqual([moved.mode, moved.rival.frame.step], ["challenge", 1]);
  const next = receive(moved, frame({ episode: "e2" }));
  assert.equal(next.rival, null);
});

test("each step lengthens trail and curve, and the state before is left as it was", () => {
  const before = begun();
  const after = receive(before, frame({ step: 1, position: [0, 1], discovered: 4 }));
  assert.deepEqual(after.player.trail, [[0, 0], [0, 1]]);
  assert.deepEqual(after.player.progress, [3 / 6, 4 / 6]);
  assert.deepEqual(before.player.trail, [[0, 0]]);
  assert.equal(after.rival, before.rival);
});

test("the same frame twice, or an older one, changes no trail", () => {
  const one = receive(begun(), frame({ step: 1, position: [0, 1] }));
  const twice = receive(one, frame({ step: 1, position: [0, 1] }));
  assert.equal(twice.player.trail.length, 2);
  assert.equal(receive(one, frame()).player.frame.step, 1);
});

test("a skipped step leaves a gap, which the history fills", () => {
  const gap = receive(begun(), frame({ step: 2, position: [1, 1] }));
  assert.equal(gap.player.hasGap, true);
  const whole = receive(gap, { kind: "history", episode: "e1", positions: [[0, 0], [0, 1], [1, 1]], discovered: [3, 4, 5] });
  assert.equal(whole.player.hasGap, false);
  assert.deepEqual(whole.player.progress, [3 / 6, 4 / 6, 5 / 6]);
});

test("a history older than the frame leaves the gap open, one of another episode is ignored", () => {
  const gap = receive(begun(), frame({ step: 2, position: [1, 1] }));
  assert.equal(receive(gap, { kind: "history", episode: "e1", positions: [[0, 0], [0, 1]], discovered: [3, 4] }).player.hasGap, true);
  assert.equal(receive(gap, { kind: "history", episode: "other", positions: [[0, 0]], discovered: [1] }).player, gap.player);
});

test("a history ahead of its frame is kept, and the frame then changes nothing in it", () => {
  const ahead = receive(begun(), { kind: "history", episode: "e1", positions: [[0, 0], [0, 1]], discovered: [3, 4] });
  assert.deepEqual(receive(ahead, frame({ step: 1, position: [0, 1] })).player.trail, [[0, 0], [0, 1]]);
});

test("a new episode begins a new trail", () => {
  const next = receive(receive(begun(), frame({ step: 1, position: [0, 1] })), frame({ episode: "e2" }));
  assert.deepEqual(next.player.trail, [[0, 0]]);
});

test("joining mid-episode asks for the history", () => {
  assert.equal(begun({ frame: frame({ step: 7 }) }).player.hasGap, true);
});

test("a refusal repaints what the server holds", () => {
  const state = receive(begun(), { kind: "refused", reason: "stale", frame: frame({ step: 1, position: [0, 1] }) });
  assert.equal(state.player.frame.step, 1);
});

test("a policy's run stays next to a ranked episode until the next one begins, whichever board reports that first", () => {
  const ended = receive(begun({ rival: null }), frame({ step: 1, outcome: "collided" }));
  const replay = apply(ended, { kind: "replay", episode: ended.player.frame.episode, about: about({ session: "p1", player: "ppo", rival: null }) });
  assert.equal(replay.rival.isReplay, true);
  assert.equal(apply(ended, { kind: "replay", episode: "another", about: about({ session: "p1" }) }), ended, "the player has gone on");
  assert.equal(receive(replay, frame({ step: 1, outcome: "collided" })).rival.session, "p1");
  assert.equal(receive(replay, frame({ episode: "e2" })).rival, null);
  assert.equal(apply(replay, { kind: "begun", about: about({ rival: null, frame: frame({ episode: "e2" }) }) }).rival, null);
});

test("an error becomes a sentence that can be dismissed, once however often it is said", () => {
  const one = receive(receive(begun(), { kind: "error", detail: "no" }), { kind: "error", detail: "no" });
  assert.equal(one.notices.length, 1);
  assert.equal(apply(one, { kind: "dismiss", id: one.notices[0].id }).notices.length, 0);
});

test("withFrame is pure", () => {
  const board = Object.freeze({ ...begun().player, trail: Object.freeze([[0, 0]]), progress: Object.freeze([0.5]) });
  assert.equal(withFrame(task, board, frame({ step: 1 })).trail.length, 2);
});

test("ghosts appear on both boards when the player's episode is over, and not before", () => {
  let state = receive(begun(), frame({ episode: "x", step: 1, position: [0, 1] }), "rival");
  assert.equal(ghostOf(state, "player"), null);
  assert.equal(ghostOf(state, "rival"), null);
  state = receive(state, frame({ step: 1, position: [1, 0], outcome: "collided" }));
  assert.deepEqual(ghostOf(state, "player"), [[0, 0], [0, 1]]);
  assert.deepEqual(ghostOf(state, "rival"), [[0, 0], [1, 0]]);
  assert.equal(ghostOf({ ...state, rival: null }, "player"), null);
});

test("a notice of the server has the plain names of policies", () => {
  const state = receive(begun(), { kind: "error", detail: "a decision took longer than 5 s, so the policy 'ppo' is paused on this board" }, "rival");
  assert.equal(state.notices[0].text, "a decision took longer than 5 s, so Expert is paused on this board");
});

test("a policy that is getting ready is no fault, and its note goes with its first move", () => {
  const state = receive(begun(), { kind: "error", detail: "the policy 'ppo' is getting ready: this takes some seconds" }, "rival");
  assert.equal(state.notices[0].tone, "note");
  assert.equal(receive(state, frame({ episode: "x" }), "rival").notices.length, 1);
  assert.equal(receive(state, frame({ episode: "x", step: 1, position: [0, 1] }), "rival").notices.length, 0);
});
