// The page of a closed evaluation: two episodes on the same instance side by side, move by move.
import { api, request } from "../common/api.js";
import { boardColours, by, put } from "../common/page.js";
import { begun, createPlayer, stepOf } from "../common/player.js";
import { many } from "../common/words.js";

/** @typedef {{episode: string, who: "agent" | "person", name: string}} Played */
/** @typedef {{place: HTMLElement, said: HTMLElement, choice: HTMLSelectElement, task: Task | null, course: Course | null, frames: Frame[]}} Side */

const pair = by("pair");
const slider = by("at", HTMLInputElement);
/** @type {Side[]} */
const sides = ["first", "second"].map((id, number) => {
  const figure = pair.children[number];
  return { place: /** @type {HTMLElement} */ (figure.querySelector(".ground")), said: /** @type {HTMLElement} */ (figure.querySelector("figcaption")),
    choice: by(id, HTMLSelectElement), task: null, course: null, frames: [] };
});
/** @type {ReturnType<typeof createPlayer> | null} */
let player = null;
let playback = begun(0);

function paint() {
  const step = stepOf(playback);
  put(by("play"), playback.isPlaying ? "Pause" : "Play");
  slider.max = String(playback.last);
  slider.value = String(step);
  slider.setAttribute("aria-valuetext", `move ${step} of ${playback.last}`);
  for (const { place, said, choice, task, course, frames } of sides) {
    if (!task || !frames.length) continue;
    const board = course ? task.boardAt(course, step) : { frame: frames[Math.min(step, frames.length - 1)], trail: [] };
    place.style.aspectRatio = task.shape(board.frame).join(" / ");
    task.paint(place, board, { name: choice.selectedOptions[0]?.text ?? "", accent: boardColours(place).you, width_px: place.clientWidth,
      height_px: place.clientHeight, dpr: devicePixelRatio || 1 });
    const { value, unit } = task.headline(board.frame);
    put(said, `${many(board.frame.step, "move")}, ${value} ${unit}${board.frame.outcome ? `, ${task.status(board.frame.outcome)}` : ""}`);
  }
}

/** Show an episode on one of the sides, from its start.
 * @param {Side} side */
async function show(side) {
  const episode = side.choice.value;
  const { task, frames } = await api.watched(episode);
  if (episode !== side.choice.value) return; // another one was chosen meanwhile
  Object.assign(side, { task, frames: frames ?? [], course: task.courseOf(side.choice.selectedOptions[0].text, frames ?? []) });
  player?.goTo(0); // the clock of the one before stops
  const last = Math.max(...sides.map((each) => Math.max(0, each.frames.at(-1)?.step ?? 0)));
  player = createPlayer(begun(last), (now) => { playback = now; paint(); });
  player.goTo(0);
}

/** Offer the episodes on an instance: an agent's first, and a person's beside it where there is one. */
async function load() {
  const instance = by("index", HTMLSelectElement);
  const index = instance.value;
  /** @type {Played[]} */
  const played = await request(`evaluations/${encodeURIComponent(pair.dataset.name ?? "")}/episodes?index=${index}`);
  if (index !== instance.value) return;
  put(by("notice"), instance.selectedOptions[0].dataset.said ?? (played.length ? "" : "Nobody has played this instance."));
  pair.hidden = !played.length;
  if (!played.length) return;
  for (const { choice } of sides) choice.replaceChildren(...played.map(({ episode, name }) => new Option(name, episode)));
  sides[1].choice.value = (played.find(({ who }) => who === "person") ?? played[played.length - 1]).episode;
  for (const side of sides) await show(side);
}

/** @param {Promise<void>} shown */
const orSay = (shown) => shown.catch((error) => put(by("notice"), error.message));
for (const side of sides) side.choice.addEventListener("change", () => orSay(show(side)));
by("index").addEventListener("change", () => orSay(load()));
by("play").addEventListener("click", () => player?.press(" "));
slider.addEventListener("input", () => player?.goTo(Number(slider.value)));
for (const what of ["theme", "resize"]) window.addEventListener(what, paint);
orSay(load());
