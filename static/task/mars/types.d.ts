// What the modules of this folder hand on to each other, the messages that are MarsExplorer's (the twins of
// app/tasks/mars/messages.py: a test compares them), and what the server answers.

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
  /** What a policy computed at the frame of `step` on its own board: probabilities of ACTIONS, in their order, what it
   * expects to earn, and the cell that it heads for. Networks have the first two, rules the last. */
  type Thought = {
    kind: "thought", episode: string, step: number, probabilities: [number, number, number, number] | null,
    value: number | null, goal: Cell | null,
  };
  /** What a look from each cell of a policy's board is expected to show, by its map of `step` alone: [row, col, unknown
   * cells]. */
  type Expected = {kind: "expected", episode: string, step: number, cells: [number, number, number][]};
  /** What GET api/episodes/ID/ghost answers. Index k of positions and discovered is the board after k moves; known_since
   * says after how many moves each cell was known (-1: never); `cells` is how many coverage refers to. */
  type Course = {
    name: string, actions: Action[], positions: Cell[], discovered: number[], cells: number, grid: string[],
    known_since: number[][], outcome: string | null, sentence: string,
  };
  /** A board of this world. */
  type Board = Omit<globalThis.Board, "frame" | "trail" | "thought" | "expected"> & {
    frame: Frame, trail: Cell[], thought?: Thought | null, expected?: Expected | null,
  };
  /** Has_range: how far the lidar sees is drawn as a ring; thought: drawn round the rover; tint: what a look from each
   * cell should show; marks: costly moves. */
  type Look = globalThis.Look & {
    ghost?: {trail: Cell[], accent: string} | null, has_range?: boolean, thought?: Thought | null, tint?: Tint | null,
    marks?: Marks | null,
  };
  /** Most: the cells that have the strongest tint. */
  type Tint = {expected: Expected, most: number};
  /** Chosen: the index of one of them. */
  type Marks = {losses: CostlyMove[], chosen: number | null};
  /** A move that cost much, with the board as it was known before it. `step` is the number of moves made before it,
   * `previous` the last of them. `missed` are the cells that the better move would soon have shown, and `seen_at` the
   * moves made when the last of them was seen. */
  type CostlyMove = {
    step: number, regret: number, action: Action, best_action: Action, kind: string, previous: Action | null,
    position: Cell, grid: string[], discovered: number, missed: Cell[], seen_at: number | null,
  };
  type Analysis = {policy: string, total: number, given_up: number, losses: CostlyMove[]};
  /** `values[k]` is what the policy expected at step k, in the points of its training. */
  type ValueCurve = {name: string, colour: string, isDashed: boolean, values: (number | null)[]};
  type Level = Choice & {pays_bonus?: boolean, example: number[]};
  type GivenMap = Choice & {size: [number, number]};
}
