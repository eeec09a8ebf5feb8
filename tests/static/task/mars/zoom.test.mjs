import assert from "node:assert/strict";
import test from "node:test";
import { LEAST_PX, shrunkTo, windowOf } from "../../../../static/task/mars/zoom.js";

const at = (side, position) => ({ rows: side, cols: side, position });
const PHONE = { width_px: 370, height_px: 400, dpr: 1 };

test("a board that fits with cells of ten pixels stands whole until somebody zooms", () => {
  const desk = { width_px: 700, height_px: 700, dpr: 1 };
  assert.deepEqual(windowOf(at(42, [0, 0]), desk, 16, null), { size: 16, left: 0, top: 0, width: 672, height: 672 });
  assert.deepEqual(windowOf(at(42, [20, 20]), desk, 16, 32), { size: 32, left: 306, top: 306, width: 700, height: 700 });
});

test("no cell is smaller than ten pixels, and the rover is in the middle or as near to it as the edge lets it", () => {
  for (const wanted of [null, 1, LEAST_PX, 30]) {
    for (const dpr of [1, 2, 2.75]) {
      for (const position of [[0, 0], [40, 3], [83, 83]]) {
        const room = { ...PHONE, dpr };
        const { size, left, top, width, height } = windowOf(at(84, position), room, 4 * dpr, wanted);
        assert.ok(size >= LEAST_PX * dpr && Number.isInteger(size));
        assert.ok(width <= 370 * dpr && height <= 400 * dpr);
        const [x, y] = [(position[1] + 0.5) * size - left, (position[0] + 0.5) * size - top];
        assert.ok(x > 0 && x < width && y > 0 && y < height, "the rover is on the stage");
        assert.ok(left >= 0 && left + width <= 84 * size && top >= 0 && top + height <= 84 * size, "nothing beyond the board");
      }
    }
  }
});

test("a board of more cells than its room has pixels is shrunk into it, and no other", () => {
  assert.equal(shrunkTo(193, 193, 254, 254), 193 / 254);
  assert.equal(shrunkTo(400, 100, 200, 200), 0.5);
  assert.equal(shrunkTo(400, 400, 256, 256), 1);
});
