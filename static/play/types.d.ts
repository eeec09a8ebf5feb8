// What the modules of this folder hand on to each other, and what the server answers them.

declare namespace Play {
  type Hint = {id: string, gain: string, line: string};
  type Ground = "free" | "unknown" | "rock" | "edge";
  type Panel = {
    role: Role, root: HTMLElement,
    part: Record<string, HTMLElement>, canvas: HTMLCanvasElement, viewer: HTMLIFrameElement,
  };
  type Sender = ReturnType<typeof import("../common/pending_moves.js").createMoveSender>;
  /** Why presses were dropped. */
  type Reason = "rock" | "edge" | "ended" | "lost" | "refused" | "full";
  type Press = {action: Action, timing: Timing, pressed_ms: number};
  type Sound = {kind: "discovery", cells: number} | {kind: "blocked" | "crash" | "finish" | "over"};
  type Tone = {hertz: number, at_s: number, for_s: number, wave: OscillatorType, loud: number};
  /** Map: by name, instead of level, size and seed. */
  type Wish = {
    level: string, map: string | null, size: number | [number, number], seed: number | null, rival: string,
    player: string,
  };
}
