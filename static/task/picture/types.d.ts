// The messages of a task that is shown as its own picture, and its courses.

declare namespace Picture {
  /** Picture: a data URL, null where the environment is shown as text; headline: the first metric so far. */
  type Frame = globalThis.Frame & {picture: string | null, text: string | null, headline: number | null};
  type MoveHistory = globalThis.MoveHistory & {headlines?: (number | null)[]};
  type Course = globalThis.Course & {frames: Frame[]};
}
