// What the modules of this folder hand on to each other; what the API answers is drawn in common/answers.d.ts.

declare namespace Me {
  /** An episode beside Expert's: the moves that it counts more, below 0 for fewer. */
  type Gap = {gap: number, isFinished: boolean};
  /** Moves without anything new, and how many were made before them. */
  type Idle = {after: number, moves: number};
}
