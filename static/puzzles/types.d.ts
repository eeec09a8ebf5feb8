// What the modules of this folder hand on to each other.

declare namespace Puzzles {
  /** What was chosen, and after how many ms. */
  type Choice = {id: string, answer: string, ms: number};
  /** By day, "2026-11-22". */
  type Answered = Record<string, Choice[]> | null;
}
