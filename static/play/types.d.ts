// What the modules of this folder hand on to each other, and what the server answers them.

declare namespace Play {
  type Panel = {
    role: Role, root: HTMLElement,
    part: Record<string, HTMLElement>, canvas: HTMLCanvasElement, viewer: HTMLIFrameElement,
  };
  type Sender = ReturnType<typeof import("../common/pending_moves.js").createMoveSender>;
  /** Why presses were dropped. */
  type Reason = {stop: string} | "ended" | "lost" | "refused" | "full";
  type Press = {action: Action, timing: Timing, pressed_ms: number};
  type Tone = {hertz: number, at_s: number, for_s: number, wave: OscillatorType, loud: number};
  /** Map: by name, instead of level, size and seed; level and size are MarsExplorer's. */
  type Wish = {
    level?: string, map: string | null, size?: number | [number, number], seed: number | null, rival: string,
    player: string,
  };
  /** The parts that a task may add to the playground. */
  type Parts = {
    views: ReturnType<typeof import("../task/mars/views.js").createViews> | null,
    costs: ReturnType<typeof import("../task/mars/costs.js").createCosts> | null,
    terrains: ReturnType<typeof import("../task/mars/terrain_dialog.js").createTerrainDialog> | null,
    charts: typeof import("../common/chart.js") | null,
  };
}
