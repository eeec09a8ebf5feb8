import assert from "node:assert/strict";
import test from "node:test";
import { qrCode } from "../../../static/study/qr.js";

/** Read a code of one block (versions 1 to 3) as a phone does: unmask it, follow the columns, and take the text.
 * @param {boolean[][]} rows */
function read(rows) {
  const size = rows.length;
  const format = [0, 1, 2, 3, 4, 5, 7, 8].map((y) => rows[y][8]).concat([7, 5, 4, 3, 2, 1, 0].map((x) => rows[8][x]));
  const bits = format.reduce((sum, isDark, at) => sum | (Number(isDark) << at), 0) ^ 0x5412;
  assert.equal(bits >> 13, 0, "level M");
  const flips = [(x, y) => (x + y) % 2, (x, y) => y % 2, (x) => x % 3, (x, y) => (x + y) % 3, (x, y) => (Math.floor(x / 3) + Math.floor(y / 2)) % 2,
    (x, y) => ((x * y) % 2) + ((x * y) % 3), (x, y) => (((x * y) % 2) + ((x * y) % 3)) % 2, (x, y) => (((x + y) % 2) + ((x * y) % 3)) % 2][(bits >> 10) & 7];
  const isFixed = (x, y) => x === 6 || y === 6 || (x < 9 && y < 9) || (x > size - 9 && y < 9) || (x < 9 && y > size - 9)
    || (size > 21 && Math.abs(x - (size - 7)) < 3 && Math.abs(y - (size - 7)) < 3);
  const read_bits = [];
  for (let pair = 0, right = size - 1; right > 0; pair++, right -= right === 8 ? 3 : 2) {
    for (let step = 0; step < size; step++) {
      const y = pair % 2 ? step : size - 1 - step;
      for (const x of [right, right - 1]) if (!isFixed(x, y)) read_bits.push(rows[y][x] !== (flips(x, y) === 0) ? 1 : 0);
    }
  }
  const bytes = Array.from({ length: read_bits.length >> 3 }, (_, at) => Number.parseInt(read_bits.slice(8 * at, 8 * at + 8).join(""), 2));
  const halves = bytes.flatMap((byte) => [byte >> 4, byte & 15]);
  assert.equal(halves[0], 4, "bytes");
  const length = 16 * halves[1] + halves[2];
  const text = Array.from({ length }, (_, at) => 16 * halves[3 + 2 * at] + halves[4 + 2 * at]);
  return { text: new TextDecoder().decode(new Uint8Array(text)), bytes };
}

const power = [1];
for (let at = 1; at < 255; at++) power.push((power[at - 1] << 1) ^ (power[at - 1] > 127 ? 0x11d : 0));
const times = (one, other) => (one && other ? power[(power.indexOf(one) + power.indexOf(other)) % 255] : 0);

test("a short code holds its text, and its error correction fits", () => {
  for (const [text, version, corrections] of [["Mars", 1, 10], ["https://a.org/#go=1", 2, 16], ["a link of two lines, and ü at its end", 3, 26]]) {
    const rows = /** @type {boolean[][]} */ (qrCode(text));
    assert.equal(rows.length, 17 + 4 * version);
    const { text: read_text, bytes } = read(rows);
    assert.equal(read_text, text);
    for (let root = 0; root < corrections; root++) assert.equal(bytes.reduce((sum, byte) => times(sum, power[root]) ^ byte, 0), 0, "a syndrome");
  }
});

test("a code grows with its text, to a version with a bit for every link", () => {
  const sizes = [14, 26, 42, 62, 84, 106, 122, 152, 180, 213].map((length) => qrCode("x".repeat(length))?.length);
  assert.deepEqual(sizes, [21, 25, 29, 33, 37, 41, 45, 49, 53, 57]);
  assert.equal(qrCode("x".repeat(214)), null);
});
