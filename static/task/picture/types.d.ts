// The messages of a task that is shown as its own picture, and its courses.

declare namespace Picture {
  /** Picture: a data URL; text: what is to be seen, where the environment says it; headline: the first metric so far. */
  type Frame = globalThis.Frame & {picture: string, text: string | null, headline: number | null};
  type MoveHistory = globalThis.MoveHistory & {headlines?: (number | null)[]};
  type Course = globalThis.Course & {frames: Frame[]};
}
