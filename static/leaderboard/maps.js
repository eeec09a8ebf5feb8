// @ts-check
// Heat maps of visits (figure 6 of the paper): one canvas for each explorer, all on one scale, so that they can be compared.

const STOPS = [[14, 11, 13], [74, 36, 24], [160, 84, 44], [255, 179, 71], [255, 246, 226]];

/** Return the colour of a share 0..1 as [r, g, b]: night, soil, accent, light; lightness rises all the way.
 * @param {number} share */
export function heat(share) {
  const at = Math.min(1, Math.max(0, share)) * (STOPS.length - 1);
  const k = Math.min(STOPS.length - 2, Math.floor(at));
  return STOPS[k].map((low, channel) => Math.round(low + (STOPS[k + 1][channel] - low) * (at - k)));
}

/** Return the common top of the scale: what one cell in a hundred exceeds in the busiest map, random walks left out.
 * @param {{name: string, visits: number[][]}[]} maps */
export function topOf(maps) {
  const steady = maps.filter(({ name }) => name !== "random");
  const tops = (steady.length ? steady : maps).map(({ visits }) => {
    const cells = visits.flat().sort((a, b) => a - b);
    return cells[Math.floor(cells.length * 0.99)] ?? 1;
  });
  return Math.max(0.5, ...tops);
}

/** The gradient of the key, for CSS. */
export const GRADIENT = `linear-gradient(90deg, ${STOPS.map((stop) => `rgb(${stop.join(" ")})`).join(", ")})`;

/** @param {HTMLElement} place @param {{name: string, colour: string, visits: number[][]}[]} maps */
export function paintMaps(place, maps) {
  const top = topOf(maps);
  place.replaceChildren(...maps.map(({ name, colour, visits }) => {
    const figure = document.createElement("figure");
    const caption = document.createElement("figcaption");
    const swatch = Object.assign(document.createElement("i"), { className: "swatch" });
    swatch.style.setProperty("--mine", colour);
    caption.append(swatch, name);
    figure.append(painted(name, visits, top), caption);
    return figure;
  }));
}

/** @param {string} name @param {number[][]} visits @param {number} top */
function painted(name, visits, top) {
  const canvas = document.createElement("canvas");
  canvas.width = visits[0].length;
  canvas.height = visits.length;
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", `Visits of ${name}: ${inWords(visits)}`);
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d", { alpha: false }));
  const image = context.createImageData(canvas.width, canvas.height);
  visits.flat().forEach((value, k) => image.data.set([...heat(Math.sqrt(value / top)), 255], 4 * k));
  context.putImageData(image, 0, 0);
  return canvas;
}

/** @param {number[][]} visits @returns how visits divide over the quarters of the grid */
export function inWords(visits) {
  const [rows, cols] = [visits.length, visits[0].length];
  const sums = { "north-west": 0, "north-east": 0, "south-west": 0, "south-east": 0 };
  visits.forEach((line, row) => line.forEach((value, col) => {
    sums[/** @type {keyof typeof sums} */ (`${row < rows / 2 ? "north" : "south"}-${col < cols / 2 ? "west" : "east"}`)] += value;
  }));
  const all = Object.values(sums).reduce((a, b) => a + b, 0) || 1;
  return Object.entries(sums).map(([where, sum]) => `${Math.round((100 * sum) / all)} percent in the ${where}`).join(", ");
}
