// What the modules of the page hand on to each other, the messages in both directions (the twin of
// app/play/messages.py: a test compares them), and what the server answers.

/** What GET api/episodes/ID/ghost answers. Index k of positions and discovered is the board after k moves; known_since
 * says after how many moves each cell was known (-1: never); `cells` is how many coverage refers to. */
type Course = {
  name: string, actions: Action[], positions: Cell[], discovered: number[], cells: number, grid: string[],
  known_since: number[][], outcome: Outcome | null, sentence: string,
};
/** What stands in a replay's page: the episode's own course, the policies on offer, in one file the policy's, too. */
type ReplayData = {
  episode: string, level: string, rows: number, cols: number, run: Course, ghosts: string[], preferred: string | null,
  ghost?: Course | null,
};
/** Where a replay stands. at: moves, with the part of the next one that has passed; the board shown is that after the
 * whole ones. hovered: the move under the pointer, shown instead while nothing plays. */
type Playback = { at: number, last: number, isPlaying: boolean, speed: number, hovered: number | null };

type PaintedBoard = ShownBoard & {trail: Cell[], frame: Frame};
/** Actions: the moves made; coverage 0..1. */
type ShownBoard = {actions: number[], outcome: string, coverage: number};

/** A policy. */
type Choice = {name: string, summary: string};
/** Pays_bonus: an episode pays for finishing and fines a failure. */
type Level = Choice & {pays_bonus?: boolean};
type GivenMap = Choice & {size: [number, number]};
/** low and high are null for a single player. */
type Interval = {mean: number, low: number | null, high: number | null};
type HumanFigure = {
  level: string, rows: number, cols: number, players: number, episodes: number, abandoned: number, score: Interval,
  steps: Interval,
};
type HumanLevel = {figures: HumanFigure[], sentence: string};
/** Frames: every one, once the episode has ended. */
type Watched = {
  episode: string, player: string, level: string, size: number | [number, number], frame: Frame, history: MoveHistory,
  frames: Frame[] | null,
};
type ApiRequest = <T>(path: string, body?: unknown, timeout_ms?: number, rest?: RequestInit) => Promise<T>;
/** How cells look; `casing` is drawn round paths and left out where there is none. The page's own colours unless a
 * palette says otherwise. */
type Soil = {shades: {"?": string, ".": string, "#": string}, edge: string, rockEdge: string, casing?: string};
/** Of labels, the 99 % line, the axis and the grid. */
type Inks = {text: string, goal: string, base: string, line: string};
/** In CSS pixels, or device pixels of a board. */
type Point = {x: number, y: number};
/** From values to CSS pixels in the chart's element. */
type ChartScale = {x: (value: number) => number, y: (value: number) => number};
type ChartAxis = {low: number, high: number, ticks: number[], text: (value: number) => string};
/** A line through (x, y), x ascending; low and high are its band, or whiskers at its points; dot is the radius of a dot
 * at its end, or of all dots where there are whiskers. */
type ChartLine = {
  colour: string, dash: number[], width?: number, alpha?: number, x: number[], y: number[], dot?: number,
  low?: (number | null)[], high?: (number | null)[], hasWhiskers?: boolean,
};
/** A chart. Lines drawn last stand in front; edges: room round the plot, CSS pixels; title: of the x axis; goal: a
 * value with a dotted line; base: the one with a solid line, else the lowest; over: draws what else there is. */
type ChartLook = {
  lines: ChartLine[], x: ChartAxis, y: ChartAxis, inks: Inks, font: string, title?: string, goal?: number,
  base?: number, edges: {left: number, right: number, top: number, bottom: number},
  over?: (context: CanvasRenderingContext2D, at: ChartScale) => void,
};
/** Moves from <= x < to. */
type Bin = {from: number, to: number, count: number};
type Mark = {name: string, moves: number};
/** Most: the cells that have the strongest tint. */
type Tint = {expected: Expected, most: number};
type Role = "player" | "rival";
/** Spectator: of an episode without a session here, live or ended. */
type Mode = "practice" | "ranked" | "watch" | "spectator";
/** One board. `trail[k]` and `discovered[k]` belong to step k; `hasGap` says that steps are missing from them.
 * `thought` is the newest of a policy that sends them, `values[k]` the return that it expected at step k (holes where
 * none came); `expected` is the newest answer about what a look from each cell should show. */
type Board = {
  session: string, name: string, frame: Frame, trail: Cell[], discovered: number[], hasGap: boolean, pace: Pace | null,
  isReplay: boolean, thought?: Thought | null, values?: (number | null)[], expected?: Expected | null,
};
/** The state; `level` is the name of the level, or that of the map. */
type GameState = {
  mode: Mode, level: string, size: number | [number, number], counts: boolean, player: Board | null,
  rival: Board | null, link: "connecting" | "open" | "lost",
  notices: {id: number, text: string, tone: "error" | "note"}[], nextNotice: number,
};
/** What can happen to the page itself; server messages arrive as `{kind: "received", role, message}`. */
type GameEvent = {kind: "begun", about: About} | {kind: "received", role: Role, message: FromServer}
  | {kind: "link", link: GameState["link"]} | {kind: "watched", level: string, size: GameState["size"], board: Board}
  | {kind: "replay", episode: string, about: About} | {kind: "notice", text: string, tone?: "error" | "note"}
  | {kind: "dismiss", id: number};
/** Chosen: the index of one of them. */
type Marks = {losses: CostlyMove[], chosen: number | null};
/** A move that cost much, with the board as it was known before it. `step` is the number of moves made before it,
 * `previous` the last of them. `missed` are the cells that the better move would soon have shown, and `seen_at` the
 * moves made when the last of them was seen. */
type CostlyMove = {
  step: number, regret: number, action: Action, best_action: Action, kind: string, previous: Action | null,
  position: Cell, grid: string[], discovered: number, missed: Cell[], seen_at: number | null,
};
type Analysis = {policy: string, total: number, given_up: number, losses: CostlyMove[]};
/** Step: the number of moves made before the loss; actions in words. */
type Loss = {step: number, regret: number, action: string, best_action: string, kind: string};
type Regret = {policy: string, total: number, given_up: number, by_kind: Record<string, number>, losses: Loss[]};
type Action = "north" | "east" | "south" | "west";
/** A position, (row, col), row 0 at the north edge. */
type Cell = [number, number];
type Outcome = "explored" | "collided" | "out_of_bounds" | "timed_out" | "abandoned";
/** What a board needs, whole. `coverage` is the share of `cells` that is discovered: of all, or on maps of those that
 * can be. `grid` holds `rows` strings of `cols` characters: ? unknown, . free, # obstacle, @ rover. reward, return and
 * score are null while a study keeps them to itself. */
type Frame = {
  kind: "frame", episode: string, step: number, rows: number, cols: number, grid: string[], position: Cell,
  discovered: number, cells: number, coverage: number, heading: Action, reward: number | null, return: number | null,
  score: number | null, outcome: Outcome | null,
};
type MoveHistory = {kind: "history", episode: string, positions: Cell[], discovered: number[]};
type Refused = {kind: "refused", reason: string, frame: Frame};
type Problem = {kind: "error", detail: string};
type Pace = {kind: "pace", mode: "follow" | "timed" | "paused", moves_per_second: number};
/** What a policy computed at the frame of `step` on its own board: probabilities of ACTIONS, in their order, what it
 * expects to earn, and the cell that it heads for. Networks have the first two, rules the last. */
type Thought = {
  kind: "thought", episode: string, step: number, probabilities: [number, number, number, number] | null,
  value: number | null, goal: Cell | null,
};
/** What a look from each cell of a policy's board is expected to show, by its map of `step` alone: [row, col, unknown
 * cells]. */
type Expected = {kind: "expected", episode: string, step: number, cells: [number, number, number][]};
/** The answer to input events: all are kept, or none for a reason that will not pass; none and no reason: send them
 * again. */
type Kept = {kind: "kept", episode: string, count: number, reason: string | null};
type FromServer = Frame | MoveHistory | Refused | Problem | Pace | Expected | Thought | Kept;
/** What POST api/sessions answers; watch: the id by which anybody may watch the board. */
type About = {
  session: string, player: string, level: string, map: string | null, size: number | [number, number], counts: boolean,
  not_attested: string | null, watch: string | null, frame: Frame,
  rival: null | {session: string, policy: string, pace: Pace, frame: Frame},
};
type Timing = {input: "key" | "touch" | null, key_down_ms: number | null, key_up_ms: number | null, client_ms: number};
/** A key, a touch, a focus or a pause in a study's episode; `client_ms` is performance.now. */
type RecordedEvent = {
  kind: "keydown" | "keyup" | "touchdown" | "touchup" | "focus" | "blur" | "visible" | "hidden" | "pause" | "resume",
  code: string | null, repeat: boolean | null, trusted: boolean | null, client_ms: number, step: number | null,
  round_trip_ms: number | null,
};
type Pending = {episode: string, step: number, action: Action, pressed_ms: number, sent_ms: number};
type PendingMoves = {pending: readonly Pending[], limit: number};
type Batch = ReturnType<typeof import("./messages.js").events>;
/** `values[k]` is what the policy expected at step k, in the points of its training. */
type ValueCurve = {name: string, colour: string, isDashed: boolean, values: (number | null)[]};


type StudyListing = {name: string, title: string, status: string, recruitment: string, warm_up: number, ranked: number};
