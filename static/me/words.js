// The sentences of a player's own page; no document here, so that node can test every one.
import { many, wholePercent } from "../common/words.js";

/** @param {{level: string, rows: number, cols: number}} terrain */
export const terrainText = ({ level, rows, cols }) => `${level} ${rows} \u00d7 ${cols}`;

/** @param {Task} task @param {Me.History} history @returns the sentence below the heading */
export function summary({ target }, { total, bests }) {
  if (!total) return "Here stand your bests, your place among people and every episode, once you have played.";
  const explored = bests.reduce((sum, { explored: count }) => sum + count, 0);
  return `You have driven ${many(total, "episode")} in this browser, and mapped ${many(explored, "terrain")} to ${target}.`;
}

/** @param {Me.Best} best @returns where a player's ranked episodes stand among the volunteers' */
export function standingText({ people: { means, you, ranked } }) {
  if (you === null) {
    return means.length ? `${many(means.length, "person", "people")} played this ranked. Play it ranked, and your dot stands among theirs.`
      : "Nobody has played this ranked yet. You could be the first.";
  }
  const mean = `You need ${you.toFixed(1)} moves on average, over ${many(ranked, "ranked episode")}`;
  if (means.length < 2) return `${mean}. You are the only person so far.`;
  const better = means.filter((each) => each < you).length;
  return `${mean}: place ${better + 1} of ${means.length} people. A terrain that was not finished counts the limit.`;
}

/** @param {Task} task @param {Me.Best} best */
export function bestText({ target }, { best, episodes, explored }) {
  if (!best) return `No terrain mapped to ${target} yet, in ${many(episodes, "episode")}.`;
  return `${wholePercent(explored / episodes)} of ${many(episodes, "episode")} mapped to ${target}.`;
}
