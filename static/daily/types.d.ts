// What the modules of this folder hand on to each other; what the API answers is drawn in common/answers.d.ts.

declare namespace Daily {
  type PolicyRow = {name: string, text: string, isReady: boolean, isBeaten: boolean};
}
