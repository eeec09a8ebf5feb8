import assert from "node:assert/strict";
import test from "node:test";
import { createMoveSender } from "../../../static/common/pending_moves.js";
import { ahead } from "../../../static/task/mars/ground.js";
import { BURST_MS, createPressQueue, MAX_WAITING, REACTION_MS } from "../../../static/play/press_queue.js";

const TIMING = { input: "key", key_down_ms: 1, key_up_ms: null, client_ms: 2 };

/** A board of one row that is seen three cells ahead, a page in front of it, and a line that answers when it is told to. */
function desk({ row = ".".repeat(60), isPractice = true } = {}) {
  const line = [];
  const dropped = [];
  let now = 1000;
  let col = 0;
  let step = 0;
  let isOpen = true;
  let isHeld = false;
  let outcome = null;
  let seen = 4;
  const grid = () => [[...row].map((mark, at) => (at === col ? "@" : at < seen ? mark : "?")).join("")];
  const take = (episode = "e1") => ({ kind: "frame", episode, step, outcome, position: [0, col], rows: 1, cols: row.length, grid: grid() });
  let frame = take();
  const sender = createMoveSender({ send: (message) => isOpen && line.push(message) > 0, sendEvents: () => {}, now_ms: () => now });
  const queue = createPressQueue({ task: { ahead }, sender, frame: () => frame, isPractice: () => isPractice, isHeld: () => isHeld,
    sendEvents: () => line.push("events"), now_ms: () => now, onDropped: (reason, count) => dropped.push([reason.stop ?? reason, count]) });
  return {
    queue, dropped, sender,
    acts: () => line.filter((message) => message.kind === "act"),
    line,
    press(action = "east", gap_ms = 5) { now += gap_ms; queue.press(action, TIMING, now); },
    repeat: (action = "east") => queue.repeat(action, TIMING),
    wait(ms) { now += ms; },
    lose() { isOpen = false; },
    connect() { [isOpen, isHeld] = [false, true]; },
    connected() { [isOpen, isHeld] = [true, false]; queue.receive(frame); },
    /** The server makes the next move that it has not made yet. */
    answer() {
      const act = line.filter((message) => message.kind === "act")[step];
      step += 1;
      col += { east: 1, west: -1 }[act.action] ?? 0;
      if (row[col] === "#") outcome = "collided";
      seen = Math.max(seen, col + 4);
      frame = take();
      queue.receive(frame);
    },
    answerAll() { while (outcome === null && sender.pending().length > 0) this.answer(); },
    begin(episode) { [step, col, outcome, seen] = [0, 0, null, 4]; frame = take(episode); queue.drop("ended"); line.length = 0; },
    receive: (message) => queue.receive(message),
    frame: () => frame,
    total: () => dropped.reduce((sum, [, count]) => sum + count, 0),
  };
}

test("a burst of forty presses loses none, in practice and in ranked play", () => {
  for (const isPractice of [true, false]) {
    const on = desk({ isPractice });
    for (let k = 0; k < 40; k++) on.press();
    assert.ok(on.acts().length <= 4, "a few are sent ahead of the answers");
    on.answerAll();
    assert.deepEqual(on.acts().map(({ step }) => step), [...Array(40).keys()]);
    assert.deepEqual(on.dropped, []);
  }
});

test("the events of a press are sent at once, before its move and before the moves that wait", () => {
  const on = desk();
  for (let k = 0; k < 9; k++) on.press();
  assert.equal(on.line.filter((message) => message === "events").length, 9);
  assert.deepEqual(on.line.slice(0, 2).map((message) => message.kind ?? message), ["events", "act"]);
});

test("in practice a burst stops before a rock, also before one that comes into sight on the way, and all are accounted for", () => {
  const on = desk({ row: "..........#...." });
  for (let k = 0; k < 40; k++) on.press();
  on.answerAll();
  assert.equal(on.frame().outcome, null);
  assert.deepEqual(on.frame().position, [0, 9]);
  assert.equal(on.acts().length + on.total(), 40);
  assert.deepEqual(on.dropped.at(-1), ["Stopped before a rock", 5], "the others were too many for the grid");
});

test("in practice nothing is sent into the unknown while answers are due", () => {
  const on = desk({ row: "...".padEnd(20, ".") });
  for (let k = 0; k < 9; k++) on.press();
  assert.equal(on.acts().length, 3, "three cells are known");
  on.answer();
  on.answer();
  assert.equal(on.acts().length, 5);
});

test("what follows in a burst is dropped with the press that would hit, until somebody has looked", () => {
  const on = desk({ row: ".#........" });
  on.press("east", 10_000);
  assert.equal(on.acts().length, 1, "a press with time to look goes where its player wants");
  const other = desk({ row: "..#......." });
  other.press("east", 10_000);
  other.press("east");
  other.press("west");
  assert.equal(other.acts().length, 1);
  other.answerAll();
  other.press("west");
  assert.equal(other.total(), 3, "still the same burst");
  other.press("west", BURST_MS);
  assert.equal(other.acts().length, 2, "a turn after a look");
  other.answerAll();
  other.press("east", BURST_MS);
  other.answerAll();
  other.press("east", REACTION_MS - 1);
  assert.equal(other.total(), 4, "too soon for somebody who had seen where the rover stopped");
  other.press("east", REACTION_MS);
  assert.equal(other.acts().length, 4);
});

test("in ranked play nothing second-guesses the player", () => {
  const on = desk({ row: ".#......", isPractice: false });
  on.press();
  on.press();
  assert.equal(on.acts().length, 2);
  on.answer();
  assert.equal(on.frame().outcome, "collided");
  assert.deepEqual(on.dropped, [["ended", 1]]);
});

test("what waits when an episode ends is dropped in sight, sent or not, and never acts on the next terrain", () => {
  const on = desk({ row: "...#....".padEnd(30, "."), isPractice: false });
  for (let k = 0; k < 12; k++) on.press();
  on.answerAll();
  assert.equal(on.frame().outcome, "collided");
  assert.equal(on.frame().step, 3);
  assert.equal(on.total(), 9);
  on.press();
  assert.deepEqual(on.dropped.at(-1), ["ended", 1]);
  on.wait(50);
  on.begin("e2");
  on.queue.press("east", TIMING, 1000);
  assert.equal(on.acts().length, 0, "pressed before the new terrain was on the board");
  assert.deepEqual(on.dropped.at(-1), ["ended", 1]);
  on.press("east", 1);
  assert.deepEqual(on.acts().map(({ episode, step }) => [episode, step]), [["e2", 0]]);
});

test("the first press on a board that came without any notice is taken", () => {
  const on = desk();
  on.queue.press("east", TIMING, 3);
  assert.equal(on.acts().length, 1);
});

test("a refusal and a lost connection drop all that waits, with a reason", () => {
  const on = desk({ isPractice: false });
  for (let k = 0; k < 7; k++) on.press();
  on.receive({ kind: "refused", reason: "step 0 is not the current one, which is 5", frame: { ...on.frame(), step: 0 } });
  assert.deepEqual(on.dropped, [["refused", 7]]);
  const lost = desk();
  for (let k = 0; k < 6; k++) lost.press();
  lost.queue.drop();
  lost.lose();
  lost.press("east", 1000);
  assert.deepEqual(lost.dropped, [["lost", 6], ["lost", 1]]);
});

test("presses on a board whose socket is being opened wait for its first frame, or are dropped when it is lost", () => {
  for (const isPractice of [true, false]) {
    const on = desk({ isPractice });
    on.connect();
    on.press("east", 1000);
    on.press("east", 200);
    assert.equal(on.repeat(), true, "a held key waits too");
    on.wait(300);
    assert.deepEqual([on.acts(), on.dropped], [[], []]);
    on.connected();
    assert.deepEqual(on.acts().map(({ step, client_ms }) => [step, client_ms]), [[0, 2500], [1, 2500]]);
    const lost = desk({ isPractice });
    lost.connect();
    lost.press();
    lost.queue.drop();
    assert.deepEqual([lost.acts(), lost.dropped], [[], [["lost", 1]]]);
  }
});

test("a refusal because the episode had ended does not count the move that ended it", () => {
  const on = desk({ isPractice: false });
  for (let k = 0; k < 4; k++) on.press();
  on.receive({ kind: "refused", reason: "the episode has ended", frame: { ...on.frame(), step: 2, outcome: "collided" } });
  assert.deepEqual(on.dropped, [["ended", 2]]);
});

test("more than anybody types is dropped in sight", () => {
  const on = desk({ isPractice: false });
  for (let k = 0; k < MAX_WAITING + 10; k++) on.press();
  assert.deepEqual(on.dropped, Array(6).fill(["full", 1]));
});

test("a queued move says when it was sent, and when its key went down", () => {
  const on = desk({ isPractice: false });
  for (let k = 0; k < 5; k++) on.press();
  on.wait(700);
  on.answer();
  assert.deepEqual([on.acts()[4].key_down_ms, on.acts()[4].client_ms], [1, 1725]);
});

test("a held key never runs ahead, and stops before what is known", () => {
  const on = desk({ row: "...#...." });
  assert.equal(on.repeat(), true);
  assert.equal(on.repeat(), true);
  assert.equal(on.repeat(), true, "two answers are due: it waits");
  assert.equal(on.acts().length, 2);
  on.answerAll();
  assert.equal(on.repeat(), false);
  assert.deepEqual(on.dropped, [["Stopped before a rock", 0]]);
  on.press("east", 100);
  assert.deepEqual(on.dropped.at(-1), ["Stopped before a rock", 1], "a press right after it has stopped");
});

test("where a board says what is allowed, a press waits for the answer before, and what is not allowed is not sent", () => {
  const sent = [];
  const dropped = [];
  let frame = { kind: "frame", episode: "e1", step: 0, outcome: null, allowed: ["right"] };
  const task = { ahead: () => "free", allowed: (on) => on.allowed };
  const sender = createMoveSender({ send: (message) => sent.push(message) > 0, sendEvents: () => {}, now_ms: () => 0 });
  const queue = createPressQueue({ task, sender, frame: () => frame, isPractice: () => false, isHeld: () => false, sendEvents: () => {},
    now_ms: () => 0, onDropped: (reason, count) => dropped.push([reason.stop, count]) });
  const answer = (allowed) => {
    frame = { ...frame, step: frame.step + 1, allowed };
    queue.receive(frame);
  };
  queue.press("pick_up", TIMING, 1);
  assert.deepEqual(dropped, [["Pick up cannot be chosen now", 0]]);
  queue.press("right", TIMING, 2);
  queue.press("left", TIMING, 3);
  queue.press("right", TIMING, 4);
  assert.deepEqual(sent.map(({ action }) => action), ["right"]);
  answer(["right"]);
  assert.deepEqual(sent.map(({ action }) => action), ["right", "right"]);
  assert.deepEqual(dropped[1], ["Left cannot be chosen now", 0]);
  answer(null);
  queue.press("left", TIMING, 5);
  queue.press("left", TIMING, 6);
  assert.equal(sent.length, 4, "where all is allowed, moves are sent ahead of the answers");
});
