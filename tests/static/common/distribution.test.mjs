import assert from "node:assert/strict";
import test from "node:test";
import { binsOf, describe, edgesOf, peopleLines, rowsOf } from "../../../static/common/distribution.js";

test("columns hold every value once, are few and of one width", () => {
  for (const values of [[87], [80, 81, 82], [75, 99, 441], [60, 61, 140, 141, 399]]) {
    const bins = binsOf(values.map((moves) => [moves, 2]), [70, 120]);
    assert.equal(bins.reduce((sum, { count }) => sum + count, 0), 2 * values.length);
    assert.ok(bins.length <= 16, `${bins.length} columns`);
    assert.equal(new Set(bins.map(({ from, to }) => to - from)).size, 1);
    assert.ok(bins[0].from <= Math.min(70, ...values) && bins.at(-1).to > Math.max(120, ...values));
    for (const { from, to, count } of bins) assert.equal(count, 2 * values.filter((each) => each >= from && each < to).length);
  }
  assert.deepEqual(binsOf([], []), []);
  const alone = binsOf([[94, 1]], []);
  assert.deepEqual([alone.length, alone[4]], [9, { from: 94, to: 95, count: 1 }], "one person is no slab");
  assert.equal(binsOf([[1, 1]], [])[0].from, 0);
});

test("labels stand in rows where they do not lie over each other", () => {
  const labels = [{ at: 50, width: 40 }, { at: 60, width: 40 }, { at: 70, width: 40 }, { at: 200, width: 40 }];
  assert.deepEqual(rowsOf(labels, 2), [0, 1, null, 0]);
});

test("who cannot see the columns is told the same", () => {
  assert.equal(describe("99 %", binsOf([[80, 2], [81, 1]], [79]), 80, [{ name: "ppo", moves: 79 }]), "Moves to 99 %: 2 from 80 to 80, 1 from 81 to 81; you 80; ppo 79");
});

test("both axes have numbers: some edges of columns, and how many people a column has", () => {
  const edges = edgesOf(binsOf([[80, 2], [112, 3]], []));
  assert.ok(edges.length >= 4 && edges.length <= 6, String(edges));
  assert.ok(edges.every((edge, index) => !index || edge - edges[index - 1] === edges[1] - edges[0]), "as far from one another");
  assert.deepEqual([1, 3, 6].map(peopleLines), [[1], [3], [3, 6]]);
});
