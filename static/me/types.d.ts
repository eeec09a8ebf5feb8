// What the modules of this folder hand on to each other, and what the server answers them.

declare namespace Me {
  type Episode = {
    episode: string, kind: "daily" | "ranked" | "practice", counts: boolean, day: string | null, level: string, rows: number,
    cols: number, outcome: string, moves: number, coverage: number, score: number, ended_ms: number,
    not_attested: string | null, met_before: boolean,
  };
  type Best = {
    level: string, rows: number, cols: number, max_steps: number, episodes: number, explored: number,
    best: Episode | null, people: {means: number[], you: number | null, ranked: number, missing: number},
  };
  type Named = {name: string | null, hidden: boolean};
  /** An episode beside Expert's: the moves that it counts more, below 0 for fewer. */
  type Gap = {gap: number, isFinished: boolean};
  type History = {total: number, episodes: Episode[], bests: Best[]};
}
