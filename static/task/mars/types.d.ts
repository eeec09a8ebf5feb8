// What the modules of this folder hand on to each other; the messages that are MarsExplorer's are drawn in messages.d.ts.

declare namespace Mars {
  /** How cells look; `casing` is drawn round paths and left out where there is none. */
  type Soil = {shades: {"?": string, ".": string, "#": string}, edge: string, rockEdge: string, casing?: string};
  type Task = TaskOf<Frame, Cell, Course, History>;
  type Words = Pick<Task, "round" | "target" | "chart" | "standing" | "outcome" | "status" | "goal" | "place" | "headline" | "ending"
    | "trialEnding" | "compare" | "inWords" | "announcement" | "sound" | "hint" | "coach">;
  /** A board of this world. */
  type Board = Omit<globalThis.Board, "frame" | "trail"> & {frame: Frame, trail: Cell[]};
  /** Has_range: how far the lidar sees is drawn as a ring; shares: of each move, drawn round the
   * rover; marks: mistakes. */
  type Look = globalThis.Look & {
    ghost?: {trail: Cell[], accent: string} | null, has_range?: boolean, shares?: number[], marks?: Marks | null,
  };
  /** Chosen: the index of one of them. */
  type Marks = {mistakes: Mistake[], chosen: number | null};
}
