// What the modules of the page hand on to each other, and the messages in both directions (the twin of
// app/humanplay/board/messages.py: a test compares them). What the API answers is drawn in answers.d.ts; what is a task's own
// stands in static/task/.

/** A course as its task has it: the board after some moves is `Task.boardAt`. */
type Course = {name: string, actions: Action[], outcome: string | null, sentence: string};
/** What stands in a replay's page: what the API answers, and in one file the policy's course. */
type ReplayData = Answers.Replay & {ghost?: Course | null};
/** Where a replay stands. at: moves, with the part of the next one that has passed; the board shown is that after the
 * whole ones. hovered: the move under the pointer, shown instead while nothing plays. */
type Playback = { at: number, last: number, isPlaying: boolean, speed: number, hovered: number | null };

/** In cells; null where a task has none. */
type Size = Answers.Board["size"];
type Watched = Omit<Answers.Watched, "task"> & {task: Task};
/** The page, or a frame in it. */
type View = Window & typeof globalThis;
/** What a browser keeps, and never throws; `read` is null where there is no JSON. */
type Store = Pick<globalThis.Storage, "getItem" | "setItem" | "removeItem"> & {read<T>(key: string): T | null, isKept(): boolean};
type ApiRequest = <T>(path: string, body?: unknown, timeout_ms?: number, rest?: RequestInit) => Promise<T>;
type Wished = Record<string, unknown>;
type Api = {
  health(): Promise<Answers.Health>, task(): Promise<Answers.Task>, levels(): Promise<Answers.Level[]>, maps(): Promise<Answers.Map[]>,
  policies(): Promise<Answers.Offer[]>, history(): Promise<Answers.OwnHistory>,
  episode(id: string): Promise<Answers.Episode>, replay(id: string): Promise<ReplayData>,
  /** Of a finished episode. */
  costs(id: string): Promise<Answers.EpisodeCosts>,
  /** Make a move that no key made. */
  act(id: string, move: {episode: string, step: number, action: string}): Promise<Frame>,
  createSession(wish: Wished): Promise<About>, about(id: string): Promise<About>,
  /** The board that this browser's player goes on with; null without one. A question names another of their boards: by
   * its id, or by what a link to watch it holds. */
  mySession(question?: {session?: string, watch?: string}): Promise<About | null>,
  /** Of a board by its id for watching, or of an episode. */
  watched(id: string): Promise<Watched>,
  nextEpisode(id: string, wish: Wished): Promise<About>, setPace(id: string, pace: Wished): Promise<Answers.Pace>,
};
/** Of labels, the goal's line, the axis and the grid. */
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
  low?: (number | null)[], high?: (number | null)[], hasWhiskers?: boolean, isColumns?: boolean,
};
/** A chart. Lines drawn last stand in front; edges: room round the plot, CSS pixels; title: of the x axis; goal: a
 * value with a dotted line and its name; base: the one with a solid line, else the lowest; over: draws what else there is. */
type ChartLook = {
  lines: ChartLine[], x: ChartAxis, y: ChartAxis, inks: Inks, font: string, title?: string,
  goal?: {at: number, text: string},  base?: number, edges: {left: number, right: number, top: number, bottom: number},
  over?: (context: CanvasRenderingContext2D, at: ChartScale) => void,
};
/** Moves from <= x < to. */
type Bin = {from: number, to: number, count: number};
type Named = {name: string, moves: number};
type Role = "player" | "rival";
/** What the server says that an episode on a board is. */
type Kind = Answers.Board["kind"];
/** Spectator: of an episode without a session here, live or ended. */
type Mode = Kind | "spectator";
/** What a path is made of: the task's own. */
type Mark = unknown;
/** One board. `trail[k]` and `progress[k]` belong to step k; `hasGap` says that steps are missing from them. */
type Board = {
  session: string, name: string, frame: Frame, trail: Mark[], progress: number[], hasGap: boolean, pace: Pace | null,
  isReplay: boolean, clock?: ClockState | null, remade?: Socket.RepeatProgress | null,
};
/** The state; `level` is the name of the level, or that of the map; `task` is null before the first board. */
type GameState = {
  mode: Mode, level: string, size: Size, counts: boolean, player: Board | null,
  rival: Board | null, link: "connecting" | "open" | "lost", task: Task | null,
  notices: {id: number, text: string, tone: "error" | "note", role: Role | null}[], nextNotice: number, opponent: Opponent | null,
  challenges: string | null,
};
/** What was done before on the terrain of one's own `episode`, which is to be beaten. */
type Opponent = {episode: string, course: Course};
/** What can happen to the page itself; server messages arrive as `{kind: "received", role, message}`. */
type GameEvent = {kind: "begun", about: About} | {kind: "received", role: Role, message: FromServer}
  | {kind: "link", link: GameState["link"]} | {kind: "watched", watched: Watched, name: string}
  | {kind: "replay", episode: string, about: About} | {kind: "notice", text: string, tone?: "error" | "note", role?: Role}
  | {kind: "dismiss", id?: number, text?: string} | {kind: "moved"} | {kind: "challenged", opponent: Opponent};
type Action = string;
/** A position, (row, col), row 0 at the north edge. */
type Cell = [number, number];
/** A board as it may be seen, whole: a task's has more. reward, return and score are null while a study keeps them to itself. */
type Frame = {
  kind: "frame", episode: string, step: number, reward: number | null, return: number | null, score: number | null,
  outcome: string | null,
};
type MoveHistory = {kind: "history", episode: string};
type Refused = {kind: "refused", reason: string, frame: Frame};
type Problem = {kind: "error", detail: string, ident?: string | null, values?: Record<string, string> | null};
type Pace = Answers.Pace;
/** Whether time runs on a board with a clock; ms: of the countdown. */
type ClockState = Socket.ClockState;
type FromServer = Frame | MoveHistory | Refused | Problem | Pace | ClockState | Socket.RepeatProgress | Socket.EventsAnswer;
/** What POST api/sessions answers, with the task as the page plays it. */
type About = Omit<Answers.Board, "task"> & {task: Task};
/** When and how a move was made; `client_ms` is performance.now. */
type Timing = Required<Pick<Socket.Act, "input" | "key_down_ms" | "key_up_ms">> & {client_ms: number};
/** A key, a touch, a focus or a pause in a study's episode. */
type RecordedEvent = Required<Socket.InputEvent>;
type Pending = {episode: string, step: number, action: Action, pressed_ms: number, sent_ms: number};
type Telemetry = ReturnType<typeof import("./telemetry.js").createTelemetry>;
type Batch = ReturnType<typeof import("./messages.js").events>;
