// @ts-check
// The buttons and the slider that set a policy's pace.

/** @type {Record<string, Record<string, unknown>>} */
const WISHES = { follow: { follow: true }, paused: { pause: true }, step: { step: true } };

/** @param {HTMLElement} bar
 * @param {(wish: Record<string, unknown>) => void} ask what POST api/sessions/{id}/pace takes */
export function startPace(bar, ask) {
  const slider = /** @type {HTMLInputElement} */ (bar.querySelector("input"));
  const askSpeed = () => ask({ moves_per_second: Number(slider.value) });
  bar.addEventListener("click", (event) => {
    const button = /** @type {Element} */ (event.target).closest("[data-pace]");
    const chosen = /** @type {HTMLElement | null} */ (button)?.dataset.pace;
    if (chosen === "timed") askSpeed();
    else if (chosen) ask(WISHES[chosen]);
  });
  slider.addEventListener("input", () => bar.querySelector("output")?.replaceChildren(`${slider.value}/s`));
  slider.addEventListener("change", askSpeed);
  // A slider left focused by the pointer would keep the arrow keys from the rover.
  slider.addEventListener("pointerup", () => slider.blur());
}
