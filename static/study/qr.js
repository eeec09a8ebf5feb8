// A QR code (ISO/IEC 18004) of a text: byte mode, error correction level M, versions 1 to 10. No document here, so node can test it.

/** Of versions 1 to 10 at level M: the blocks, and the error correction bytes of each. */
const BLOCKS = [1, 1, 1, 2, 2, 4, 4, 4, 5, 5];
const CORRECTION = [10, 16, 26, 18, 24, 16, 18, 22, 22, 26];
/** @type {((x: number, y: number) => boolean)[]} */
const MASKS = [
  (x, y) => (x + y) % 2 === 0,
  (_, y) => y % 2 === 0,
  (x) => x % 3 === 0,
  (x, y) => (x + y) % 3 === 0,
  (x, y) => (Math.floor(x / 3) + Math.floor(y / 2)) % 2 === 0,
  (x, y) => ((x * y) % 2) + ((x * y) % 3) === 0,
  (x, y) => (((x * y) % 2) + ((x * y) % 3)) % 2 === 0,
  (x, y) => (((x + y) % 2) + ((x * y) % 3)) % 2 === 0,
];

/** Return the rows of a text's QR code, true for dark; null for a text that is too long (213 bytes).
 * @param {string} text @returns {boolean[][] | null} */
export function qrCode(text) {
  const bytes = [...new TextEncoder().encode(text)];
  const version = BLOCKS.findIndex((_, index) => bytes.length <= capacity(index + 1)) + 1;
  if (version === 0) return null;
  const { cells, isFixed } = fixedPatterns(version);
  place(cells, isFixed, withCorrection(padded(bytes, version), version));
  const drawn = MASKS.map((mask, number) => masked(cells, isFixed, mask, number));
  return drawn.reduce((best, other) => (penalty(other) < penalty(best) ? other : best));
}

/** The bytes of a version, of data and of error correction.
 * @param {number} version */
function allBytes(version) {
  const aligned = version === 1 ? 0 : Math.floor(version / 7) + 2;
  const squares = aligned ? (25 * aligned - 10) * aligned - 55 : 0;
  return Math.floor(((16 * version + 128) * version + 64 - squares - (version > 6 ? 36 : 0)) / 8);
}
/** @param {number} version */
const dataBytes = (version) => allBytes(version) - BLOCKS[version - 1] * CORRECTION[version - 1];
/** @param {number} version @returns how many bytes of text it holds, besides the mode and the length */
const capacity = (version) => dataBytes(version) - (version < 10 ? 2 : 3);

/** @param {number[]} bytes @param {number} version @returns the bytes of data: mode, length, text and filling */
function padded(bytes, version) {
  const lengthBits = version < 10 ? 8 : 16;
  const bits = [...bitsOf(4, 4), ...bitsOf(bytes.length, lengthBits), ...bytes.flatMap((byte) => bitsOf(byte, 8)), 0, 0, 0, 0];
  const filled = Array.from({ length: Math.ceil(bits.length / 8) }, (_, at) => Number.parseInt(bits.slice(8 * at, 8 * at + 8).join("").padEnd(8, "0"), 2));
  const whole = filled.slice(0, dataBytes(version));
  for (let filler = 0xec; whole.length < dataBytes(version); filler ^= 0xec ^ 0x11) whole.push(filler);
  return whole;
}
/** @param {number} number @param {number} length @returns its bits, the highest first */
const bitsOf = (number, length) => Array.from({ length }, (_, at) => (number >> (length - 1 - at)) & 1);

/** Split the data into blocks, add each one's error correction, and interleave them.
 * @param {number[]} bytes @param {number} version */
function withCorrection(bytes, version) {
  const count = BLOCKS[version - 1];
  const extra = CORRECTION[version - 1];
  const short = count - (allBytes(version) % count);
  const length = Math.floor(allBytes(version) / count) - extra;
  const factors = generator(extra);
  let from = 0;
  const blocks = Array.from({ length: count }, (_, at) => bytes.slice(from, from += length + (at < short ? 0 : 1)));
  const corrections = blocks.map((block) => remainder(block, factors));
  const interleaved = (/** @type {number[][]} */ parts, /** @type {number} */ longest) =>
    Array.from({ length: longest }, (_, at) => parts.filter((part) => at < part.length).map((part) => part[at])).flat();
  return [...interleaved(blocks, length + 1), ...interleaved(corrections, extra)];
}
/** Multiply in the field of 256 elements with the polynomial 0x11d.
 * @param {number} one @param {number} other */
function times(one, other) {
  let product = 0;
  for (let bit = 7; bit >= 0; bit--) product = (product << 1) ^ ((product >> 7) * 0x11d) ^ (((other >> bit) & 1) * one);
  return product;
}
/** @param {number} degree @returns the factors of the Reed-Solomon generator, without the highest */
function generator(degree) {
  const factors = [...new Array(degree - 1).fill(0), 1];
  for (let step = 0, root = 1; step < degree; step++, root = times(root, 2)) {
    for (let at = 0; at < degree; at++) factors[at] = times(factors[at], root) ^ (factors[at + 1] ?? 0);
  }
  return factors;
}
/** @param {number[]} block @param {number[]} factors @returns its error correction */
function remainder(block, factors) {
  /** @type {number[]} */
  const rest = new Array(factors.length).fill(0);
  for (const byte of block) {
    const lead = byte ^ /** @type {number} */ (rest.shift());
    rest.push(0);
    factors.forEach((factor, at) => { rest[at] ^= times(factor, lead); });
  }
  return rest;
}

/** Draw all that does not depend on the text.
 * @param {number} version */
function fixedPatterns(version) {
  const size = 17 + 4 * version;
  const cells = Array.from({ length: size }, () => new Array(size).fill(false));
  const isFixed = Array.from({ length: size }, () => new Array(size).fill(false));
  const set = (/** @type {number} */ x, /** @type {number} */ y, /** @type {boolean} */ isDark) => {
    if (x < 0 || y < 0 || x >= size || y >= size) return;
    cells[y][x] = isDark;
    isFixed[y][x] = true;
  };
  const square = (/** @type {number} */ x, /** @type {number} */ y, /** @type {number} */ reach, /** @type {(ring: number) => boolean} */ isDark) => {
    for (let dy = -reach; dy <= reach; dy++) for (let dx = -reach; dx <= reach; dx++) set(x + dx, y + dy, isDark(Math.max(Math.abs(dx), Math.abs(dy))));
  };
  for (let at = 0; at < size; at++) {
    set(6, at, at % 2 === 0);
    set(at, 6, at % 2 === 0);
  }
  for (const [x, y] of [[3, 3], [size - 4, 3], [3, size - 4]]) square(x, y, 4, (ring) => ring !== 2 && ring !== 4);
  const centres = alignmentCentres(version);
  for (const x of centres) {
    for (const y of centres) {
      const isCorner = (x === 6 && y === 6) || (x === 6 && y === size - 7) || (x === size - 7 && y === 6);
      if (!isCorner) square(x, y, 2, (ring) => ring !== 1);
    }
  }
  drawFormat(set, size, 0);
  if (version > 6) {
    const bits = (version << 12) | checkBits(version, 12, 0x1f25);
    for (let at = 0; at < 18; at++) {
      const [far, near, isDark] = [size - 11 + (at % 3), Math.floor(at / 3), ((bits >> at) & 1) === 1];
      set(far, near, isDark);
      set(near, far, isDark);
    }
  }
  return { cells, isFixed };
}
/** @param {number} version @returns {number[]} */
function alignmentCentres(version) {
  if (version === 1) return [];
  const last = 10 + 4 * version;
  return version < 7 ? [6, last] : [6, 6 + (last - 6) / 2, last];
}
/** @param {number} number @param {number} length @param {number} polynomial @returns the remainder of a BCH code */
function checkBits(number, length, polynomial) {
  let rest = number;
  for (let step = 0; step < length; step++) rest = (rest << 1) ^ ((rest >> (length - 1)) * polynomial);
  return rest;
}
/** Draw the level and the mask, twice.
 * @param {(x: number, y: number, isDark: boolean) => void} set @param {number} size @param {number} mask */
function drawFormat(set, size, mask) {
  const bits = ((mask << 10) | checkBits(mask, 10, 0x537)) ^ 0x5412; // level M is 0
  for (let at = 0; at < 15; at++) {
    const isDark = ((bits >> at) & 1) === 1;
    if (at < 8) set(8, at < 6 ? at : at + 1, isDark);
    else set(at === 8 ? 7 : 14 - at, 8, isDark);
    if (at < 8) set(size - 1 - at, 8, isDark);
    else set(8, size - 15 + at, isDark);
  }
  set(8, size - 8, true);
}

/** Place the bytes in columns of two, upwards and downwards in turn.
 * @param {boolean[][]} cells @param {boolean[][]} isFixed @param {number[]} bytes */
function place(cells, isFixed, bytes) {
  const size = cells.length;
  let at = 0;
  for (let right = size - 1; right > 0; right -= 2) {
    if (right === 6) right = 5; // the column of the timing pattern
    const isUpwards = ((right + 1) & 2) === 0;
    for (let step = 0; step < size; step++) {
      const y = isUpwards ? size - 1 - step : step;
      for (const x of [right, right - 1]) {
        if (isFixed[y][x]) continue;
        cells[y][x] = at < 8 * bytes.length && ((bytes[at >> 3] >> (7 - (at & 7))) & 1) === 1;
        at += 1;
      }
    }
  }
}
/** @param {boolean[][]} cells @param {boolean[][]} isFixed @param {(x: number, y: number) => boolean} mask @param {number} number of the mask */
function masked(cells, isFixed, mask, number) {
  const drawn = cells.map((row, y) => row.map((isDark, x) => (isFixed[y][x] ? isDark : isDark !== mask(x, y))));
  drawFormat((x, y, isDark) => { drawn[y][x] = isDark; }, cells.length, number);
  return drawn;
}
/** Count what makes a code hard to read: runs of five and more, squares of one colour, and too much of one.
 * @param {boolean[][]} cells */
function penalty(cells) {
  const size = cells.length;
  let points = 0;
  for (const lines of [cells, cells.map((_, x) => cells.map((row) => row[x]))]) {
    for (const line of lines) {
      for (let at = 1, run = 1; at <= size; at++) {
        if (at < size && line[at] === line[at - 1]) run += 1;
        else {
          if (run >= 5) points += run - 2;
          run = 1;
        }
      }
    }
  }
  for (let y = 1; y < size; y++) {
    for (let x = 1; x < size; x++) {
      const isDark = cells[y][x];
      if (cells[y - 1][x] === isDark && cells[y][x - 1] === isDark && cells[y - 1][x - 1] === isDark) points += 3;
    }
  }
  const dark = cells.flat().filter(Boolean).length / (size * size);
  return points + 10 * Math.floor(Math.abs(dark - 0.5) * 20);
}
