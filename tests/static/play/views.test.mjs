import assert from "node:assert/strict";
import { test } from "node:test";
import { clientUrl, showBoard } from "../../../static/play/views.js";

test("the 3-D client is told to draw on a canvas of its own only where the processor draws", () => {
  assert.equal(clientUrl(false), "viewer/client/");
  assert.equal(clientUrl(true), "viewer/client/?fixedDpr=0.75&software-canvas");
});

test("a frame loads the client once, and then only changes the board that its name says", () => {
  const loads = [];
  let shown = 0;
  const viewer = {
    contentWindow: { name: "", showBoard: () => { shown += 1; } },
    getAttribute: () => loads.at(-1),
    removeAttribute: () => loads.push(null),
    set src(url) { loads.push(url); },
  };
  showBoard(viewer, "a", false);
  showBoard(viewer, "b?camera=map", false);
  assert.deepEqual(loads, ["viewer/client/"]);
  assert.equal(viewer.contentWindow.name, "b?camera=map");
  assert.equal(shown, 1);
  showBoard(viewer, null, false);
  assert.deepEqual(loads, ["viewer/client/", null]);
});
