// The best replay of the week on a board that nobody has begun: it moves until the first key, and asks the server once.
import { request } from "../common/api.js";
import { boardColours, create } from "../common/page.js";
import { begun, createPlayer } from "../common/player.js";
import { many, percent } from "../common/words.js";

/** Moves per second; and how long the end is shown. */
const SPEED = 8;
const REST_MS = 3000;

/** Show it over a board; return what takes it away, or null where there is none.
 * @param {HTMLElement} board @param {Task} task @param {() => boolean} isWanted still, once it is there */
export async function showBest(board, task, isWanted) {
  const found = /** @type {ReplayData | null} */ (await request("replay-of-the-week").catch(() => null));
  if (!found || !isWanted()) return null;
  const { run } = found;
  const place = create("div", [create("canvas", [], { "data-part": "canvas", role: "img", "aria-label": "A replay" })], { class: "ground" });
  const last = task.boardAt(run, run.actions.length).frame;
  const end = `${many(run.actions.length, "move")}, ${percent(task.headline(last).share)} % mapped`;
  const line = create("p", [create("b", "Best replay of the week"), ` ${end}. Press a key or touch to play.`]);
  const over = create("div", [place, line], { class: "demo", "data-testid": "demo" });
  board.append(over);
  let rest = 0;
  const player = createPlayer(begun(run.actions.length, SPEED), ({ isPlaying }, before) => {
    task.paint(place, task.boardAt(run, player.step), { name: "A person", accent: boardColours(place).you, width_px: place.clientWidth, height_px: place.clientHeight, dpr: devicePixelRatio || 1, has_range: true });
    if (before.isPlaying && !isPlaying) rest = setTimeout(() => player.press(" "), REST_MS);
  });
  player.goTo(0);
  player.press(" ");
  return () => {
    clearTimeout(rest);
    player.goTo(0);
    clearTimeout(rest);
    over.remove();
  };
}
