import assert from "node:assert/strict";
import test from "node:test";
import { socketUrl } from "../../../static/common/socket.js";

test("the socket keeps scheme and prefix of the app", () => {
  assert.equal(socketUrl("abc", "ws/sessions", "https://host/lab/mars/?x=1#watch=abc"), "wss://host/lab/mars/ws/sessions/abc");
  assert.equal(socketUrl("abc", "ws/sessions", "http://127.0.0.1:8000/"), "ws://127.0.0.1:8000/ws/sessions/abc");
});
