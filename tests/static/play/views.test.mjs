import assert from "node:assert/strict";
import test from "node:test";
import { viewerUrl } from "../../../static/play/views.js";

test("the 3-D view has an address relative to the page, with coarser pixels where the processor draws", () => {
  assert.equal(viewerUrl("ab_c", false), "viewer/ab_c/");
  assert.equal(viewerUrl("ab_c", true), "viewer/ab_c/?fixedDpr=0.75&software-canvas");
});
