// @ts-check
// The card at the end of an episode: what happened, in how many moves, the score with its explanation, and the policy on the same ground.
import { put } from "../common/page.js";
import { compare, score } from "../common/words.js";
import { ending, scoreWhy } from "./words.js";

/** Paint the end card of the player's board; return whether it has just appeared.
 * @param {Record<string, HTMLElement>} part of the player's panel @param {GameState} state
 * @param {boolean} paysBonus whether the level pays for finishing */
export function paintEndCard(part, { mode, player, rival }, paysBonus) {
  const frame = player?.frame;
  const wasHidden = part.end.hidden;
  part.end.hidden = !frame?.outcome;
  if (!frame || part.end.hidden) return false;
  const { title, line } = ending(frame);
  put(part["end-title"], title);
  put(part["end-line"], line);
  put(part["end-score"], score(frame.score));
  put(part["end-why"], mode === "watch" ? "" : scoreWhy(frame, paysBonus));
  const compared = compare(frame, rival?.frame ?? null, rival?.name ?? "", mode === "watch" ? player?.name : "You");
  put(part["end-compare"], compared);
  part["end-compare"].hidden = !compared;
  part.again.hidden = mode === "ranked"; // a terrain counts once
  /** @type {HTMLAnchorElement} */ (part["replay-link"]).href = `replay/${encodeURIComponent(frame.episode)}`;
  return wasHidden;
}
