// The screen on which one drives: the board first, since a key press waits for it, then numbers, curve, coach, pause and end card.
import { paintProgress } from "../common/chart.js";
import { startEndCard } from "../common/end_card.js";
import { createSlow, by, put, SLOW_MS } from "../common/page.js";
import { lengthOf, paintAllowed } from "../common/task.js";
import { t } from "../common/texts.js";
import { score } from "../common/words.js";
import { knowsTheEnd, screenOf } from "./state.js";
import { state } from "./store.js";
import * as words from "./words.js";

/** @param {Frame} frame @param {Study.Participant} participant @param {(action: Action) => string} keyOf */
function paintNumbers(frame, { phase, rules, task, hint }, keyOf) {
  const { value, unit } = task.headline(frame);
  put(by("moves"), lengthOf(task, frame.step));
  put(by("moves-name"), task.clock ? t("play.seconds", "Seconds") : t("play.moves", "Moves"));
  put(by("curve-title"), task.clock ? t("play.curve_frames", "{title} over frames", { title: task.chart.title }) : t("play.curve", "{title} over moves", { title: task.chart.title }));
  put(by("coverage"), value);
  put(by("unit"), ` ${unit.split(" ")[0]}`);
  put(by("headline-name"), task.chart.title);
  put(by("outcome"), task.status(frame.outcome));
  by("hint").hidden = hint === "";
  put(by("hint"), hint);
  by("score-row").hidden = frame.score === null;
  put(by("score"), score(frame.score));
  by("hidden-score").hidden = frame.score !== null;
  by("coach").hidden = phase !== "tutorial" || frame.outcome !== null;
  by("skip").hidden = phase !== "tutorial" || frame.outcome !== null;
  by("open-give-up").hidden = phase === "tutorial" || frame.outcome !== null;
  const [title, line] = task.coach(frame, keyOf, rules.coverage);
  put(by("coach-title"), title);
  put(by("coach-line"), line);
}
const [slowly, afterFrame] = [SLOW_MS, 0].map((wait_ms) => createSlow((/** @type {() => void} */ paintCurve) => paintCurve(), wait_ms));
const card = startEndCard();
/** @returns {boolean} whether the card has just come up */
function paintEnd() {
  const frame = state.game.player?.frame;
  const { participant } = state;
  if (!participant || !frame?.outcome) return card.show(null, {});
  const isKnown = knowsTheEnd(state);
  const content = words.endCard(frame, participant);
  card.part.next.setAttribute("aria-disabled", String(!isKnown));
  return card.show(frame, isKnown ? { ...content, practise: participant.phase === "tutorial" } : { ...content, note: "", next: t("loading.title", "One moment") });
}

/** @param {Study.State | null} before @param {Study.Look} look
 * @param {(action: Action) => string} keyOf what stands on an action's first key */
export function paintPlayScreen(before, { palette, accent, inks, font }, keyOf) {
  const { game, participant, isPaused } = state;
  const { player } = game;
  document.body.dataset.paused = String(isPaused);
  if (screenOf(state) !== "play" || !player || !participant) return;
  const isNew = before === null || screenOf(before) !== "play";
  if (isNew || player !== before.game.player) {
    const { clientWidth: width_px, clientHeight: height_px } = by("matrix");
    participant.task.paint(by("matrix"), player, { name: t("map.name", "the {round}", { round: participant.task.round }), palette, accent, width_px, height_px, dpr: devicePixelRatio || 1, follows: true });
  }
  if (isNew || player !== before.game.player || participant !== before.participant) {
    paintNumbers(player.frame, participant, keyOf);
    paintAllowed(participant.task, player.frame);
    const paintCurve = () => paintProgress(by("chart"), participant.task, [{ board: player, colour: accent }], { font, inks });
    (participant.task.clock ? slowly : afterFrame)(paintCurve);
    document.body.dataset.ended = String(player.frame.outcome !== null);
    document.body.dataset.phase = participant.phase ?? "";
  }
  const pause = by("pause");
  if (pause.hidden === isPaused) {
    pause.hidden = !isPaused;
    if (isPaused) by("resume").focus({ preventScroll: true });
    else by("field").focus({ preventScroll: true });
  }
  const hadFocus = by("end").contains(document.activeElement);
  if (paintEnd()) {
    if (!document.querySelector("dialog[open]")) by("next").focus({ preventScroll: true });
  } else if (hadFocus && by("end").hidden) by("field").focus({ preventScroll: true });
}
