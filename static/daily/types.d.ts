// What the modules of this folder hand on to each other; what the API answers is drawn in common/answers.d.ts.

declare namespace Daily {
  /** People who are level: `episode` is one's own where one is among them. */
  type PeopleRow = {rank: number, text: string, people: number, you: boolean, episode: string | null};
  type PolicyRow = {name: string, text: string, isReady: boolean, isBeaten: boolean};
}
