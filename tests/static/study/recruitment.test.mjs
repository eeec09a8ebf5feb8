// The invitation in the address, the server's refusals as sentences, and until when a session is supervised.
import assert from "node:assert/strict";
import { test } from "node:test";
import { invitationIn, outsideIds, bareAddress } from "../../../static/study/api.js";
import { sentence, supervisedLine } from "../../../static/study/words.js";

test("the token is read from the address and taken out of it, with the ids of a platform", () => {
  assert.equal(invitationIn("?PROLIFIC_PID=p&invitation=7K3M-XWT5"), "7K3M-XWT5");
  assert.equal(invitationIn("?invitation="), null);
  assert.equal(invitationIn(""), null);
  assert.equal(bareAddress("https://h/p/study/a?x=1&invitation=7K3M#top"), "https://h/p/study/a#top");
  assert.equal(bareAddress("https://h/study/a?PROLIFIC_PID=p"), "https://h/study/a");
  assert.deepEqual(outsideIds("?PROLIFIC_PID=p"), { PROLIFIC_PID: "p" });
});

test("a refusal is a sentence", () => {
  assert.equal(sentence("this study is by invitation: open the link that you were sent"), "This study is by invitation: open the link that you were sent.");
  assert.equal(sentence("Closed."), "Closed.");
  assert.equal(sentence(""), "");
});

test("supervision is shown while it holds", () => {
  assert.equal(supervisedLine(null, 5), "");
  assert.equal(supervisedLine(5, 5), "");
  assert.match(supervisedLine(3_600_000, 5), /^Supervised until .*\d.*\.$/);
});
