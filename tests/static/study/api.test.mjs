import assert from "node:assert/strict";
import test from "node:test";
import { ROOT } from "../../../static/common/api.js";
import { createStudyApi, outsideIds, studyName } from "../../../static/study/api.js";
import { MARS } from "../task/mars/about.mjs";

test("the name of the study and the ids of another site are read from the address", () => {
  assert.equal(studyName("/study/demo"), "demo");
  assert.equal(studyName("/mars/study/demo-2/"), "demo-2");
  assert.equal(studyName("/"), "");
  assert.deepEqual(outsideIds("?PROLIFIC_PID=p%201&STUDY_ID=&invitation=7K3M"), { PROLIFIC_PID: "p 1", STUDY_ID: "" });
  assert.deepEqual(outsideIds("?PROLIFIC_PID=a&PROLIFIC_PID=b"), { PROLIFIC_PID: ["a", "b"] });
  assert.equal(outsideIds(`?id=${"x".repeat(500)}`).id.length, 201, "more than the server takes, so that it is refused");
});

test("calls go below api, wherever the app is mounted", async () => {
  const asked = [];
  globalThis.fetch = async (path, options) => { asked.push([path.replace(ROOT, ""), options.body]); return { ok: true, json: async () => ({ task: MARS }) }; };
  const study = createStudyApi("demo");
  await study.join({ A: "1" });
  await study.giveUp("e1", 3);
  await study.terrain(2, "ranked");
  assert.deepEqual(asked, [["api/studies/demo/join", '{"outside_ids":{"A":"1"}}'], ["api/studies/demo/give-up", '{"episode":"e1","step":3}'],
    ["api/studies/demo/debrief/2?phase=ranked", undefined]]);
});
