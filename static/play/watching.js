// @ts-check
// Somebody else's episode, by the link in the address: live while it runs, then a replay.
import { socketUrl } from "../common/connections.js";
import { elementsOf, put } from "../common/page.js";
import { boardAt } from "../common/replay.js";
import { follow } from "../common/socket.js";

/** @typedef {import("../common/api.js").Watched} Watched */
const TICK_MS = 160;

/**
 * Return the name of a watched board.
 * @param {string} player
 */
export const watchedName = (player) => ({ human: "Somebody", script: "A script" })[player] ?? player;

/**
 * Return the board of a watched episode as it stood after some moves of its replay, as it stands now where it runs.
 * @param {Watched} watched
 * @param {number} step
 * @returns {import("../common/game_state.js").Board}
 */
export function watchedBoard({ episode, player, frame, history, frames }, step) {
  const now = { session: episode, name: watchedName(player), frame, trail: history.positions, discovered: history.discovered,
    hasGap: false, pace: null, isReplay: false };
  return { ...now, ...(frames && boardAt(frames, now.name, step)), session: episode };
}

/**
 * @param {Document} page
 * @param {{load: (episode: string) => Promise<Watched>, base: string, dispatch: (event: import("../common/game_state.js").Event) => void,
 *   onPlay: () => void}} how onPlay: begin a board of one's own
 */
export function createWatching(page, { load, base, dispatch, onPlay }) {
  const by = elementsOf(page);
  const slider = by("watching-at", HTMLInputElement);
  /** @type {ReturnType<typeof follow> | null} */
  let follower = null;
  /** @type {Watched | null} */
  let watched = null;
  let step = 0;
  let isPlaying = false;
  const last = () => watched?.frames?.at(-1)?.step ?? 0;

  function show() {
    if (!watched) return;
    const { frames, level, size } = watched;
    by("watching-replay").hidden = frames === null;
    put(by("watching-text"), frames ? "You are watching a replay. This was somebody else's episode." : "You are watching. This is somebody else's episode.");
    put(by("watching-play"), isPlaying ? "Pause" : "Play");
    slider.max = String(last());
    slider.value = String(step);
    slider.setAttribute("aria-valuetext", `move ${step} of ${last()}`);
    put(by("watching-step"), `${step} / ${last()}`);
    dispatch({ kind: "watched", level, size, board: watchedBoard(watched, step) });
  }
  /** @param {number} to */
  function moveTo(to) {
    step = Math.max(0, Math.min(to, last()));
    isPlaying &&= step < last();
    show();
  }
  /** @param {string} episode */
  async function reload(episode) {
    const wasLive = watched?.frames === null;
    watched = await load(episode);
    isPlaying = watched.frames !== null && !wasLive;
    step = wasLive ? last() : 0;
    if (watched.frames) {
      stopFollowing();
      dispatch({ kind: "link", link: "open" }); // the server closed the socket at the end
    }
    show();
  }
  function stopFollowing() {
    follower?.close();
    follower = null;
  }
  by("watching-play").addEventListener("click", () => {
    isPlaying = !isPlaying;
    moveTo(isPlaying && step >= last() ? 0 : step);
  });
  by("watching-next").addEventListener("click", () => { isPlaying = false; moveTo(step + 1); });
  slider.addEventListener("input", () => { isPlaying = false; moveTo(Number(slider.value)); });
  by("watching-own").addEventListener("click", onPlay);
  setInterval(() => isPlaying && moveTo(step + 1), TICK_MS);

  return {
    /**
     * Watch an episode until `stop`; ApiError when there is none to watch.
     * @param {string} episode
     */
    async begin(episode) {
      await reload(episode);
      dispatch({ kind: "link", link: "open" });
      if (watched?.frames) return;
      follower = follow({ url: socketUrl(episode, base, "ws/watch"),
        onMessage(message) {
          dispatch({ kind: "received", role: "player", message });
          if (message.kind === "frame" && message.outcome) reload(episode).catch(() => follower?.restart());
        },
        onLink: (link) => dispatch({ kind: "link", link }),
        beforeRetry: async () => { await reload(episode); return follower !== null; } });
    },
    stop() {
      stopFollowing();
      watched = null;
      isPlaying = false;
    },
    silence_ms: () => follower?.silence_ms() ?? Infinity,
    restart: () => follower?.restart(),
  };
}
