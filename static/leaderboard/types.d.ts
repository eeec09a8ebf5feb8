// What the modules of this folder hand on to each other; what the API answers is drawn in common/answers.d.ts.

declare namespace Leaderboard {
  /** Values low..high stand at the shares from..to of the width. */
  type Piece = {low: number, high: number, from: number, to: number};
  type Figure = Answers.LeaderboardPeople | Answers.PolicyFigure;
  type Scale = {near: Piece, far: Piece | null, ticks: number[], farTicks: number[]};
  type ChartPlace = {chart: HTMLElement, legend: HTMLElement, note: HTMLElement};
  type Measure = "steps" | "score";
  type View = "people" | "policies";
  type State = {view: View, boards: Answers.LeaderboardEntry[], board: string, measure: Measure, detail: Answers.Leaderboard | null, evaluates: boolean};
  type Row = {who: string, name: string, colour: string, dash: string, figure: Figure | null, policy: Answers.LeaderboardPolicy | null};
}
