// What the modules of this folder hand on to each other, the messages that are MarsExplorer's (the twins of
// app/humanplay/tasks/mars/messages.py: a test compares them), and what the server answers.

declare namespace Mars {
  /** How cells look; `casing` is drawn round paths and left out where there is none. */
  type Soil = {shades: {"?": string, ".": string, "#": string}, edge: string, rockEdge: string, casing?: string};
  type Outcome = "explored" | "collided" | "out_of_bounds" | "timed_out" | "abandoned";
  /** What a board needs, whole. `coverage` is the share of `cells` that is discovered: of all, or on maps of those that
   * can be. `grid` holds `rows` strings of `cols` characters: ? unknown, . free, # obstacle, @ rover. reward, return and
   * score are null while a study keeps them to itself. */
  type Frame = {
    kind: "frame", episode: string, step: number, rows: number, cols: number, grid: string[], position: Cell,
    discovered: number, cells: number, coverage: number, heading: Action, reward: number | null,
    return: number | null, score: number | null, outcome: Outcome | null,
  };
  type Task = TaskOf<Frame, Cell, Course, MoveHistory>;
  type Words = Pick<Task, "round" | "target" | "chart" | "standing" | "outcome" | "status" | "goal" | "place" | "headline" | "ending"
    | "trialEnding" | "compare" | "inWords" | "announcement" | "sound" | "hint" | "coach">;
  type MoveHistory = {kind: "history", episode: string, positions: Cell[], discovered: number[]};
  /** What GET api/episodes/ID/ghost answers. Index k of positions and discovered is the board after k moves; known_since
   * says after how many moves each cell was known (-1: never); `cells` is how many coverage refers to. */
  type Course = {
    name: string, actions: Action[], positions: Cell[], discovered: number[], cells: number, grid: string[],
    known_since: number[][], outcome: string | null, sentence: string,
  };
  /** A board of this world. */
  type Board = Omit<globalThis.Board, "frame" | "trail"> & {frame: Frame, trail: Cell[]};
  /** Has_range: how far the lidar sees is drawn as a ring; shares: of each move, drawn round the
   * rover; marks: mistakes. */
  type Look = globalThis.Look & {
    ghost?: {trail: Cell[], accent: string} | null, has_range?: boolean, shares?: number[], marks?: Marks | null,
  };
  /** Chosen: the index of one of them. */
  type Marks = {mistakes: Mistake[], chosen: number | null};
  /** Moves that together cost something, with the board as it was known before the costliest, which has the number `step`
   * from 0; `previous` is the one before it. `missed` are the cells that Expert's would soon have shown, and `seen_at` the
   * moves made when the last of them was seen. */
  type Mistake = {
    first: number, last: number, step: number, cost: number, action: Action, expert_action: Action, kind: string, previous: Action | null,
    position: Cell, grid: string[], discovered: number, missed: Cell[], seen_at: number | null,
  };
  type Advice = globalThis.Advice;
  /** An episode beside Expert's, in moves. reason: why no move is judged; expert_moves: null where Expert's file is missing. */
  type Costs = {
    policy: string, reason: string | null, counts: number, expert_moves: number | null, total: number | null,
    given_up: number | null, gained: number | null, mistakes: Mistake[],
  };
  type Level = Choice & {pays_bonus?: boolean, example: number[]};
  type GivenMap = Choice & {size: [number, number]};
}
