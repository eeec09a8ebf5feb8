// What the API answers and sockets carry, drawn from their own description: `make tables` draws it again.

declare namespace Picture {
  /** What a board shows; its figures are null where a study hides them. */
  type Frame = {
    kind: "frame",
    episode: string,
    step: number,
    /** a data URL; null where it is shown as text */
    picture: string | null,
    text: string | null,
    /** the actions that may be chosen; null: all of them */
    allowed: string[] | null,
    /** of the last move */
    reward: number | null,
    /** sum of the rewards */
    return: number | null,
    /** what the description calls it: the return, or a value of info */
    score: number | null,
    headline: number | null,
    outcome: "succeeded" | "failed" | "ended" | "timed_out" | "abandoned" | "environment_failed" | null,
  };
  /** The headline metric after 0, 1, 2, ... moves. */
  type History = {
    kind: "history",
    episode: string,
    headlines: (number | null)[],
  };
  /** The course of an episode as the frames that were seen. */
  type Course = {
    /** who drove */
    name: string,
    /** one a move */
    actions: string[],
    outcome: string | null,
    score: number | null,
    /** what it came to, in words that follow the name */
    sentence: string,
    /** from the start to the end; of long episodes some are left out */
    frames: Frame[],
  };
}
