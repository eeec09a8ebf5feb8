// What the modules of this folder hand on to each other; the messages that are MarsExplorer's are drawn in messages.d.ts.

declare namespace Mars {
  /** How cells look; `casing` is drawn round paths and left out where there is none. */
  type Soil = {shades: {"?": string, ".": string, "#": string}, edge: string, rockEdge: string, casing?: string};
  type Task = TaskOf<Frame, Cell, Course, History>;
  type Words = Pick<Task, "round" | "target" | "chart" | "standing" | "beside" | "outcome" | "status" | "goal" | "place" | "shareText" | "tries" | "headline"
    | "ending" | "trialEnding" | "verdict" | "compare" | "inWords" | "announcement" | "sound" | "hint" | "coach">;
  /** A board of this world. */
  type Board = Omit<globalThis.Board, "frame" | "trail"> & {frame: Frame, trail: Cell[]};
  /** Has_range: how far the lidar sees is drawn as a ring; follows: a large board shows the rover's surroundings, and the
   * whole in a small map; shares: of each move, drawn round the
   * rover; marks: mistakes. */
  type Look = globalThis.Look & {
    ghost?: {trail: Cell[], accent: string} | null, has_range?: boolean, follows?: boolean, shares?: number[], marks?: Marks | null,
  };
  /** The part of a board on its stage, and a cell, in device pixels. */
  type Window = {size: number, left: number, top: number, width: number, height: number};
  type Shape = {rows: number, cols: number};
  /** Chosen: the index of one of them; without numbers its arrows stand alone. */
  type Marks = {mistakes: Mistake[], chosen: number | null, hasNumbers?: boolean};
}
