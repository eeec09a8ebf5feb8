// @ts-check
// A key, an arrow button or a swipe that is held: its move is repeated at a set pace until it is let go. No document here, and the
// clock is an argument, so node can test every rule.

/** Held for so long, a key repeats. */
export const DELAY_MS = 250;
/** Moves a second that can be chosen; 0 turns repeating off. */
const PACES = Object.freeze([0, 4, 8, 12]);
export const DEFAULT_PACE = 8;

/** @param {string | null} stored @returns the moves a second that a stored setting stands for */
export function paceOf(stored) {
  const pace = Number(stored ?? DEFAULT_PACE);
  return PACES.includes(pace) ? pace : DEFAULT_PACE;
}

/**
 *   pace       moves a second; 0 repeats nothing
 *   mayRepeat  asked before each repetition: whether a held key drives now
 *   repeat     moves once more; false lets go of the key
 *   after      calls a function in so many ms and returns what cancels it
 * @param {{pace: () => number, mayRepeat: () => boolean, repeat: (action: Action) => boolean, now_ms: () => number,
 *   after: (wait_ms: number, work: () => void) => () => void}} how */
export function createHeldKey({ pace, mayRepeat, repeat, now_ms, after }) {
  /** @type {{holder: string, action: Action} | null} */
  let held = null;
  let due_ms = 0;
  let cancel = () => {};

  function stop() {
    cancel();
    held = null;
  }
  function schedule() {
    cancel = after(Math.max(0, due_ms - now_ms()), () => {
      if (!held) return;
      if (pace() === 0 || !mayRepeat() || !repeat(held.action)) return stop();
      const between_ms = 1000 / pace();
      due_ms = Math.max(due_ms, now_ms() - between_ms / 2) + between_ms; // a page that was busy catches up on nothing
      schedule();
    });
  }
  return {
    /** A key went down, after which its own move was made; it takes the place of the one that was held before.
     * @param {string} holder what is held: a key's code, or the name of a button @param {Action} action */
    down(holder, action) {
      stop();
      if (pace() === 0 || !mayRepeat()) return;
      held = { holder, action };
      due_ms = now_ms() + DELAY_MS;
      schedule();
    },
    /** A key came up; nothing changes when it is not the one that is held.
     * @param {string} holder */
    up(holder) { if (held?.holder === holder) stop(); },
    stop,
    holder: () => held?.holder ?? null,
  };
}
