// The debrief: own figures, own trials as bars, and the replay of a warm-up terrain next to a policy's.
import { create, by, put } from "../common/page.js";
import { begun, createPlayer, stepOf } from "../common/player.js";
import { many, score } from "../common/words.js";
import { screenOf } from "./state.js";
import { debriefLine } from "./words.js";

/** Moves per second. */
const SPEED = 6.25;

/** @param {{look: () => Study.Look, terrain: (index: number, phase: Study.Shown) => Promise<Study.Runs>,
 *   losses: (index: number, phase: Study.Shown) => Promise<Regret>, dispatch: (event: Study.Event) => void,
 *   warmUps: () => number, index: () => number | undefined}} how index of the terrain whose replay is shown */
export function createDebrief({ look, terrain, losses, dispatch, warmUps, index: shown }) {
  /** @type {ReturnType<typeof createPlayer> | null} */
  let player = null;
  /** @type {Task} */
  let task;

  /** Load both runs of a terrain: the warm-up ones first, then the ranked ones, which a closed study shows.
   * @param {number} index */
  async function load(index) {
    const phase = index < warmUps() ? "warm_up" : "ranked";
    const number = phase === "ranked" ? index - warmUps() : index;
    try {
      by("own-losses").replaceChildren();
      show(index, await terrain(number, phase));
      const regret = await losses(number, phase).catch(() => null); // a board too large for it, or a busy server: nothing is shown
      if (regret && shown() === index) paintLosses(by("own-losses"), regret, ({ step }) => player?.goTo(step));
    } catch (error) {
      dispatch({ kind: "notice", text: /** @type {Error} */ (error).message });
    }
  }
  /** Show the runs of a terrain from their start.
   * @param {number} index @param {Study.Runs} answer */
  function show(index, { own, policy }) {
    const runs = { own: task.courseOf("You", own), policy: task.courseOf(policy.name, policy.frames) };
    const last = Math.max(0, ...Object.values(runs).map((course) => (course ? course.actions.length : 0)));
    player?.goTo(0); // the clock of the one before stops
    player = createPlayer(begun(last, SPEED), (playback) =>
      dispatch({ kind: "replay-moved", replay: { index, runs, playback } }));
    player.goTo(0);
  }
  by("replay-play").addEventListener("click", () => player?.press(" "));
  by("replay-step").addEventListener("click", () => player?.press("ArrowRight"));
  by("replay-at").addEventListener("input", () => player?.goTo(Number(by("replay-at", HTMLInputElement).value)));
  by("replay-index").addEventListener("change", () => load(Number(by("replay-index", HTMLSelectElement).value)));

  /** @param {Study.Debrief} debrief */
  function paintFigures(debrief) {
    const { episodes, mean_score, mean_steps, warm_up_terrains: terrains, ranked_terrains: ranked } = debrief;
    put(by("own-score"), score(mean_score));
    put(by("own-steps"), mean_steps === null ? "\u2013" : mean_steps.toFixed(1));
    put(by("own-explored"), `${episodes.filter(({ outcome }) => outcome === "explored").length} of ${episodes.length}`);
    put(by("debrief-line"), debriefLine(debrief));
    by("trials").replaceChildren(create("h2", "Terrain by terrain"), trialTable(episodes));
    const choice = by("replay-index", HTMLSelectElement);
    put(by("replay-label"), ranked ? "Terrain" : "Warm-up terrain");
    if (choice.options.length !== terrains + ranked) {
      const named = (/** @type {number} */ count, /** @type {string} */ before, /** @type {number} */ first) =>
        Array.from({ length: count }, (_, index) => new Option(`${before}${index + 1} of ${count}`, String(first + index)));
      choice.replaceChildren(...named(terrains, ranked ? "warm-up " : "", 0), ...named(ranked, "ranked ", terrains));
    }
  }
  /** @param {Study.Debrief["episodes"]} episodes @returns a table with a row for each trial, its score as a bar */
  function trialTable(episodes) {
    const table = document.createElement("table");
    table.className = "bars";
    table.innerHTML = "<thead><tr><th scope=\"col\">Terrain</th><th scope=\"col\">Outcome</th><th scope=\"col\">Moves</th><th scope=\"col\">Score</th></tr></thead>";
    const body = table.createTBody();
    for (const { trial, outcome, steps, score: value } of episodes) {
      const row = body.insertRow();
      row.append(create("th", String(trial + 1), { scope: "row" }));
      row.insertCell().textContent = task.status(outcome);
      row.insertCell().textContent = String(steps);
      const cell = row.insertCell();
      const bar = document.createElement("i");
      bar.style.setProperty("--share", String(Math.max(0, Math.min(1, value))));
      cell.append(bar, score(value));
    }
    return table;
  }
  /** @param {Study.Replay} replay */
  function paintReplay({ index, runs, playback }) {
    const step = stepOf(playback);
    put(by("policy-name"), runs.policy?.name ?? "");
    put(by("replay-play"), playback.isPlaying ? "Pause" : "Play");
    by("replay-index", HTMLSelectElement).value = String(index);
    const slider = by("replay-at", HTMLInputElement);
    slider.max = String(playback.last);
    slider.value = String(step);
    slider.setAttribute("aria-valuetext", `move ${step} of ${playback.last}`);
    const { palette, accent, rival } = look();
    for (const [run, course] of Object.entries(runs)) {
      if (!course) continue;
      const place = /** @type {HTMLElement} */ (by(`${run}-board`).parentElement);
      const board = task.boardAt(course, step);
      const { step: moves, outcome } = board.frame;
      place.style.aspectRatio = task.shape(board.frame).join(" / ");
      task.paint(place, board, { name: course.name, palette, accent: run === "own" ? accent : rival, width_px: place.clientWidth,
        height_px: place.clientHeight, dpr: devicePixelRatio || 1 });
      const { value, unit } = task.headline(board.frame);
      put(by(`${run}-now`), `${many(moves, "move")}, ${value} ${unit.split(" ")[0]}${outcome ? `, ${task.status(outcome)}` : ""}`);
    }
  }
  return {
    load,
    /** @param {Study.State} state @param {Study.State | null} before */
    paint(state, before) {
      if (screenOf(state) !== "debrief" || !state.participant?.debrief) return;
      ({ task } = state.participant);
      const isNew = before === null || screenOf(before) !== "debrief";
      if (isNew || state.participant !== before.participant) paintFigures(state.participant.debrief);
      put(by("finish"), state.looksBack ? "Back to my completion code" : "Finish and get my completion code");
      by("replay").hidden = state.replay === null;
      if (state.replay && (isNew || state.replay !== before.replay)) paintReplay(state.replay);
    },
  };
}

/** @param {Loss} loss @returns the sentence of one loss */
function lossLine({ step, regret, action, best_action, kind }) {
  const why = { "hidden pocket": ", leaving a pocket behind", "last cells": ", on the last cells" }[kind] ?? "";
  return `Move ${step + 1}: you lost ${many(regret, "move")} going ${action} instead of ${best_action}${why}.`;
}

/** @param {Regret} regret @returns the sentence above the list */
function regretLine({ policy, losses, given_up }) {
  if (given_up > 0) return `Giving up cost ${many(given_up, "move")}: ${policy} would have finished from there.`;
  if (!losses.length) return "No single move cost you much.";
  return `Judged with the whole terrain known, and ${policy} going on after each move.`;
}

/** Fill a place with the losses of an episode, the greatest first, each with a button.
 * @param {HTMLElement} place @param {Regret} regret @param {(loss: Loss) => void} onChoose */
function paintLosses(place, regret, onChoose) {
  place.replaceChildren(create("p", regretLine(regret)), create("ol", regret.losses.map((loss) => {
    const choose = create("button", "Show", { type: "button", class: "quiet", "aria-label": `Show: move ${loss.step + 1}` });
    choose.addEventListener("click", () => onChoose(loss));
    return create("li", [`${lossLine(loss)} `, choose]);
  })));
}
