// What the modules of this folder hand on to each other, and what the server answers them.

declare namespace Leaderboard {
  /** Values low..high stand at the shares from..to of the width. */
  type Piece = {low: number, high: number, from: number, to: number};
  type Scale = {near: Piece, far: Piece | null, ticks: number[], farTicks: number[]};
  type Curve = {steps: number[], mean: number[], low: number[], high: number[]};
  type Trial = {trial: number, players: number, score: Interval, steps: Interval};
  type Figure = {
    episodes: number, score: Interval, steps: Interval, completed: number, curve: Curve | null,
    visits: number[][] | null,
  };
  type People = Figure & {players: number, trials: Trial[], set?: string, everybody?: {players: number, steps: {mean: number} | null}, claim?: string, abandoned?: number};
  type Policy = {
    name: string, state: "ready" | "missing" | "computing" | "waiting" | "failed", done: number, of: number, figure: Figure | null,
    error: string | null, summary?: string,
    shipped?: {command: string} | null,
  };
  type BoardListing = {
    id: string, title: string, study: string | null, level: string, rows: number, cols: number, max_steps: number,
    terrains: number, players: number, episodes: number, missing: Missing | null,
  };
  /** Players that a mean still needs, of how many, and how many ranked episodes each. */
  type Missing = {players: number, of: number, episodes: number};
  type Detail = {board: BoardListing, people: People | null, policies: Policy[]};
  type ChartPlace = {chart: HTMLElement, legend: HTMLElement, note: HTMLElement};
  type Measure = "steps" | "score";
  type Named = {people: {name: string, gap: number, episodes: number, you: boolean}[], you: Me.Named | null};
  type View = "people" | "policies";
  type State = {view: View, boards: BoardListing[], board: string, measure: Measure, detail: Detail | null, evaluates: boolean};
  type Row = {who: string, name: string, colour: string, dash: string, figure: Figure | null, policy: Policy | null};
}
