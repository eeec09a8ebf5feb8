import assert from "node:assert/strict";
import { test } from "node:test";
import { adviceText, wedges } from "../../../../static/task/mars/course.js";

test("a wedge points where Expert would go, and is as long as it is sure", () => {
  const [east, south] = wedges([0, 0.7, 0.3, 0], 10);
  assert.ok(east.points[0][0] > 0 && Math.abs(east.points[0][1]) < 1e-9);
  assert.ok(south.points[0][1] > 0 && Math.abs(south.points[0][0]) < 1e-9);
  assert.ok(east.points[0][0] > south.points[0][1]);
  assert.equal(wedges([0.01, 0.99, 0, 0], 10).length, 1);
  assert.equal(wedges([NaN, 1, 0, 0], 10).length, 1);
});

test("Expert speaks in moves: what it needs, and what the move made cost", () => {
  const course = { actions: ["north", "north"], outcome: "collided" };
  const line = (rest, step = 0) => adviceText({ shares: [], action: "east", needs: 23, cost: 2, ...rest }, course, step);
  assert.equal(line({}), "Expert would go east and need 23 more moves from here; the move made, north, cost 2 moves.");
  assert.equal(line({ action: "north", needs: 1, cost: 0 }), "Expert would go north too, and need 1 more move from here.");
  assert.match(line({ cost: 1 }), /, cost 1 move\.$/);
  assert.match(line({ cost: 0 }), /, was as good\.$/);
  assert.match(line({ cost: -3 }), /, gained 3 moves, as it turned out\.$/);
  assert.match(line({ cost: 60 }, 1), /; the move made, north, ended the episode\.$/);
  assert.match(line({ needs: null, cost: 0 }), /and not get there in the moves that are left; the move made, north, was as good\.$/);
});
