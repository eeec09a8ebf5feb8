// The types that several modules of the page share; `Array`s of cells are rows from the north, columns from the west.

type Cell = import("./messages.js").Cell;
type Frame = import("./messages.js").Frame;
type Action = import("./messages.js").Action;
type Outcome = import("./messages.js").Outcome;

/** What GET api/episodes/ID/ghost answers. Index k of positions and discovered is the board after k moves; known_since
 * says after how many moves each cell was known (-1: never); `cells` is how many coverage refers to. */
type Course = {
  name: string, actions: Action[], positions: Cell[], discovered: number[], cells: number, grid: string[],
  known_since: number[][], outcome: Outcome | null, sentence: string,
};
/** What stands in a replay's page: the episode's own course and the policies on offer; in one file the policy's, too. */
type ReplayData = {
  episode: string, level: string, rows: number, cols: number, run: Course, ghosts: string[], preferred: string | null,
  ghost?: Course | null,
};
/** Where a replay stands. at: moves, with the part of the next one that has passed; the board shown is that after the
 * whole ones. hovered: the move under the pointer, shown instead while nothing plays. */
type Playback = { at: number, last: number, isPlaying: boolean, speed: number, hovered: number | null };
