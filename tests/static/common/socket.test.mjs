import assert from "node:assert/strict";
import test from "node:test";
import { backoff_ms, follow } from "../../../static/common/socket.js";

/** The browser's WebSocket, opened and closed by hand; `all` are those made so far. */
class FakeSocket {
  static OPEN = 1;
  static all = [];
  constructor() { this.readyState = 0; this.sent = []; FakeSocket.all.push(this); }
  open() { this.readyState = 1; this.onopen(); }
  close() { if (this.readyState === 3) return; this.readyState = 3; this.onclose(); }
  send(text) { this.sent.push(text); }
}
const soon = (ms) => new Promise((done) => { setTimeout(done, ms); });

/** A follower whose server is asked by hand: `answers` take what each question before a new attempt is told. */
function following() {
  globalThis.WebSocket = FakeSocket;
  FakeSocket.all = [];
  const answers = [], links = [], heldBack = [];
  const follower = follow({ url: "ws://here", onMessage: () => {}, onLink: (link) => links.push(link),
    beforeRetry: () => new Promise((answer, fail) => { answers.push({ answer, fail }); }), onHeldBack: () => heldBack.push(FakeSocket.all.length) });
  return { follower, answers, links, heldBack };
}

test("after a lost connection the server is asked, then the connection is opened again", async () => {
  const { follower, answers, links } = following();
  FakeSocket.all[0].open();
  FakeSocket.all[0].close();
  assert.equal(follower.send({}), false);
  await soon(300);
  answers[0].answer(true);
  await soon(0);
  FakeSocket.all[1].open();
  assert.equal(follower.send({ kind: "act" }), true);
  assert.deepEqual(links, ["open", "lost", "open"]);
  follower.close();
});

test("a restart while the server is being asked leaves one connection, which stays", async () => {
  const { follower, answers, links } = following();
  FakeSocket.all[0].open();
  FakeSocket.all[0].close();
  await soon(300); // asked, and no answer yet
  follower.restart();
  await soon(300); // asked again
  answers[0].answer(true);
  answers[1].answer(true);
  await soon(0);
  assert.equal(FakeSocket.all.length, 2, "the first connection and one more");
  FakeSocket.all[1].open();
  await soon(600);
  assert.equal(follower.send({ kind: "act" }), true);
  assert.equal(links.at(-1), "open");
  follower.close();
});

test("sockets that do not open while the server answers are named after the second", async () => {
  const { follower, answers, heldBack } = following();
  for (const wait_ms of [300, 600]) {
    FakeSocket.all.at(-1).close();
    await soon(wait_ms);
    answers.at(-1).answer(true);
    await soon(0);
  }
  assert.deepEqual(heldBack, [2], "before the third");
  FakeSocket.all.at(-1).open();
  FakeSocket.all.at(-1).close();
  await soon(300);
  answers.at(-1).answer(true);
  await soon(0);
  assert.deepEqual(heldBack, [2], "one that had opened is only lost");
  follower.close();
});

test("a session that is gone for good is not asked for again, a server that does not answer is", async () => {
  for (const [answer, questions] of [["answer", 1], ["fail", 2]]) {
    const { follower, answers } = following();
    FakeSocket.all[0].close();
    await soon(300);
    answers[0][answer](false);
    await soon(600);
    assert.equal(answers.length, questions);
    assert.equal(FakeSocket.all.length, 1);
    follower.close();
  }
});

test("a server that was only slow keeps its socket, and one whose socket stays silent gets a new one", async () => {
  const { follower, answers, links } = following();
  const [socket] = FakeSocket.all;
  socket.open();
  follower.check();
  assert.deepEqual(socket.sent, ['{"kind":"history"}']);
  socket.onmessage({ data: '{"kind":"history","episode":"e","positions":[[0,0]],"discovered":[1]}' });
  assert.deepEqual(links, ["open", "open"]);
  follower.check();
  await soon(1900);
  answers[0].answer(true);
  await soon(0);
  assert.deepEqual([links.at(-1), FakeSocket.all.length], ["lost", 2]);
  follower.close();
});

test("attempts to reconnect grow apart, to five seconds", () => {
  assert.deepEqual([0, 1, 2, 9].map(backoff_ms), [250, 500, 1000, 5000]);
});
