// The page of a challenge: what is seen before the first move, what is to be beaten, and who has taken it up.
import { api, request } from "../common/api.js";
import { boardColours, by, create, createRepaint, createSizes, put } from "../common/page.js";
import { loadTask } from "../common/task.js";
import { challengerText } from "./words.js";

const episode = decodeURIComponent(location.pathname.split("/").at(-1) ?? "");
const place = by("matrix");
const sizes = createSizes(() => repaint());
/** @type {{task: Task, run: Course} | null} */
let shown = null;
const repaint = createRepaint(() => {
  if (!shown) return;
  const { task, run } = shown;
  const accent = boardColours(place).you;
  task.paint(place, task.boardAt(run, 0), { name: "The start", accent, ...sizes.of(place), dpr: devicePixelRatio || 1 });
});

async function load() {
  try {
    const [task, { run }] = await Promise.all([loadTask(), api.replay(episode)]);
    shown = { task, run };
    put(by("status"), "");
    put(by("rules"), task.standing ?? "");
    by("take").setAttribute("href", `../#challenge=${encodeURIComponent(episode)}`);
    repaint();
    const people = /** @type {Answers.Challenger[]} */ (await request(`episodes/${encodeURIComponent(episode)}/challengers`));
    by("people").replaceChildren(...people.map((person) => create("li", challengerText(person))));
    by("taken").hidden = people.length === 0;
  } catch (error) {
    put(by("status"), `${/** @type {Error} */ (error).message} Trying again.`);
    setTimeout(load, 2000);
  }
}
sizes.watch(place);
addEventListener("theme", () => repaint());
load();
