// What the API answers and sockets carry, drawn from their own description: `make tables` draws it again.

declare namespace Mars {
  /** Everything a board needs, and nothing that the rover has not discovered. */
  type Frame = {
    kind: "frame",
    episode: string,
    step: number,
    rows: number,
    cols: number,
    /** a string a row: `?` unknown, `.` free, `#` obstacle, `@` rover */
    grid: string[],
    /** on a map above 128 cells a side a character of grid stands for four cells; else absent */
    packed?: true | null,
    /** [row, col], row 0 at the north edge */
    position: [number, number],
    /** cells */
    discovered: number,
    /** that count: all, or on maps and levels with walls those that can be discovered */
    cells: number,
    /** discovered / cells */
    coverage: number,
    heading: "north" | "east" | "south" | "west",
    /** of the last move (eq. 8); this and the next two null where a study hides them */
    reward: number | null,
    /** sum of the rewards */
    return: number | null,
    /** normalized (section 3.2) */
    score: number | null,
    outcome: "explored" | "collided" | "out_of_bounds" | "timed_out" | "abandoned" | null,
  };
  /** The path so far; index 0 is the start. */
  type History = {
    kind: "history",
    episode: string,
    positions: [number, number][],
    discovered: number[],
  };
  /** The course of an episode. Index k of `positions` and `discovered` is the board after k moves. */
  type Course = {
    /** who drove */
    name: string,
    actions: ("north" | "east" | "south" | "west")[],
    /** [row, col], row 0 at the north edge */
    positions: [number, number][],
    /** cells */
    discovered: number[],
    /** that coverage refers to, as in a frame */
    cells: number,
    /** what was known at the end, as in a frame, without the rover */
    grid: string[],
    /** moves after which each cell was known, by rows; -1: never */
    known_since: number[][],
    outcome: "explored" | "collided" | "out_of_bounds" | "timed_out" | "abandoned",
    /** normalized (section 3.2) */
    score: number,
    /** what it came to, in words that follow the name */
    sentence: string,
  };
  /** Moves that together cost something, and the board before the costliest. */
  type Mistake = {
    /** its first move, from 0 */
    first: number,
    /** its last move */
    last: number,
    /** its costliest move */
    step: number,
    /** moves */
    cost: number,
    /** made there */
    action: "north" | "east" | "south" | "west",
    expert_action: "north" | "east" | "south" | "west",
    kind: "hidden pocket" | "early detour" | "last cells" | "ended early",
    /** the action before it; null at the start */
    previous: "north" | "east" | "south" | "west" | null,
    /** [row, col], row 0 at the north edge */
    position: [number, number],
    /** as in a frame */
    grid: string[],
    /** cells */
    discovered: number,
    /** cells that Expert's move would soon have shown */
    missed: [number, number][],
    /** moves after which the last of them was seen; null: never */
    seen_at: number | null,
  };
}
