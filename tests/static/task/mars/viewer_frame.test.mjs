import assert from "node:assert/strict";
import { mock, test } from "node:test";
import { clientUrl, reloadWhenLost, showBoard } from "../../../../static/task/mars/views.js";

/** A frame as the page sees it: `drawn` is its mark, `loads` what was loaded in it, `shown` how often its board was asked for. */
class Viewer extends EventTarget {
  constructor() {
    super();
    Object.assign(this, { loads: [], shown: 0, drawn: null, dataset: {}, ownerDocument: { baseURI: "http://here/" } });
    const location = { replace: (url) => this.loads.push(String(url)) };
    this.contentWindow = { name: "", location, showBoard: () => { this.shown += 1; } };
  }
  getAttribute(name) { return name === "src" ? this.loads.at(-1) ?? null : this.drawn; }
  setAttribute(name, value) { this.drawn = value; }
  removeAttribute(name) {
    if (name === "src") this.loads.push(null);
    else this.drawn = null;
  }
  set src(url) { this.loads.push(url); }
  tell(what) { this.dispatchEvent(new Event(what)); }
}

test("the 3-D client is told to draw on a canvas of its own only where the processor draws", () => {
  assert.equal(clientUrl(false), "viewer/client/");
  assert.equal(clientUrl(true), "viewer/client/?fixedDpr=0.75&software-canvas");
});

test("a frame loads the client once, and then only changes the board that its name says", () => {
  const viewer = new Viewer();
  showBoard(viewer, "a", false);
  viewer.drawn = "true";
  showBoard(viewer, "a?camera=map", false);
  assert.equal(viewer.drawn, "true", "the same board in another way leaves the picture where it is");
  showBoard(viewer, "b?camera=map", false);
  assert.equal(viewer.drawn, null, "the picture of another board leaves the stage");
  assert.deepEqual(viewer.loads, ["viewer/client/"]);
  assert.equal(viewer.contentWindow.name, "b?camera=map");
  assert.equal(viewer.shown, 2);
  showBoard(viewer, null, false);
  assert.deepEqual(viewer.loads, ["viewer/client/", null]);
});

test("a client that is lost is loaded again, later each time, and not for ever", () => {
  mock.timers.enable({ apis: ["setTimeout"] });
  const viewer = new Viewer();
  reloadWhenLost(viewer, true);
  showBoard(viewer, "a", true);
  for (const wait_ms of [300, 3000, 15_000]) {
    viewer.drawn = "true";
    viewer.tell("viewerlost");
    viewer.tell("viewerlost");
    assert.equal(viewer.drawn, null);
    const before = viewer.loads.length;
    mock.timers.tick(wait_ms - 1);
    assert.equal(viewer.loads.length, before);
    mock.timers.tick(1);
    assert.deepEqual(viewer.loads.slice(before), ["http://here/viewer/client/?fixedDpr=0.75&software-canvas"]);
  }
  viewer.tell("viewerlost");
  mock.timers.tick(600_000);
  assert.equal(viewer.loads.length, 4);
  mock.timers.reset();
});

test("a frame in which something else was loaded is loaded again, and shows what was wished for meanwhile", () => {
  mock.timers.enable({ apis: ["setTimeout"] });
  const viewer = new Viewer();
  reloadWhenLost(viewer, false);
  showBoard(viewer, "a", false);
  const { contentWindow } = viewer;
  viewer.contentWindow = { location: contentWindow.location, get name() { throw new Error("closed"); } };
  viewer.tell("load");
  showBoard(viewer, "b", false);
  mock.timers.tick(300);
  assert.equal(viewer.loads.at(-1), "http://here/viewer/client/");
  viewer.contentWindow = contentWindow;
  viewer.tell("load");
  assert.deepEqual([contentWindow.name, viewer.shown], ["b", 1]);
  mock.timers.tick(600_000);
  assert.equal(viewer.loads.length, 2);
  mock.timers.reset();
});
