import assert from "node:assert/strict";
import test from "node:test";
import { cellSize } from "../../../../static/task/mars/board.js";
import { runs } from "../../../../static/task/mars/words.js";

test("cells are whole device pixels, and a row paints in runs", () => {
  assert.equal(cellSize(200, 400, 21, 21, 1), 9);
  assert.equal(cellSize(200, 100, 5, 7, 2), 40);
  assert.equal(cellSize(0, 0, 5, 7, 1), 1);
  assert.deepEqual(runs("??.#"), [[0, 2, "?"], [2, 1, "."], [3, 1, "#"]]);
});
