// What a page knows of a task: what the server says of it, and what the folder of its assets adds, static/task/ASSETS/index.js.
// A page hands on frames, marks and courses; only the folder looks into them.

/** Codes of event.code for each action. */
type Keys = Record<Action, string[]>;
/** How a board is drawn: its player's name and colour, the room for it in CSS pixels, and what a folder's own parts of
 * the page add. `ghost` is another's path; `palette` are a study's colours instead of the page's own. */
type Look = {
  name: string, accent: string, width_px: number, height_px: number, dpr: number, palette?: string,
  ghost?: {trail: Mark[], accent: string} | null, [more: string]: unknown,
};
/** What a page knows of the ground of a move: it may be made; more is to be seen first; or why it would end the episode. */
type Ground = "free" | "unknown" | {stop: string};
type Sound = {kind: "gain", count: number} | {kind: "blocked" | "crash" | "finish" | "over"};
type Hint = {id: string, gain: string, line: string};
type CostWords = {summary: string, mistakes: string[], rest: string[]};
/** What a folder exports: `taskOf` makes it of what the server says, for its own frames, marks, courses and histories. */
type Task = TaskOf<Frame, Mark, Course, MoveHistory>;
interface TaskOf<F, M, C, H> extends Answers.Task {
  /** A policy's name as pages say it. */
  nameOf(policy: string): string;
  /** Colour (a custom property of base.css) and dash of policies whose lines are the same on every plot; others take the
   * rest in turn. */
  lines?: Readonly<Record<string, [string, string]>>;
  /** Whether a policy knows how instances are drawn: then it is not compared with people. Left out where none does. */
  isInformed?(policy: string): boolean;
  /** The actions in the order in which they are named and stand on the pad. */
  order: Action[];
  /** What an episode is played on or called, in the words of a page; and what it has to reach. */
  round: string;
  target: string;
  /** The curve below the boards: what it shows, the value to reach, and an axis for curves on a plot of some height;
   * say: a value in words. */
  chart: {
    title: string, goal?: {at: number, text: string}, axis: (height_px: number, values: number[]) => ChartAxis,
    say: (value: number) => string,
  };

  /** Draw a board in its place, and say it in words there. */
  paint(place: HTMLElement, board: {frame: F, trail: M[]}, look: Look): void;
  /** What a path is made of, and the height of the curve; the same of all steps in a history. */
  mark(frame: F): M;
  progress(frame: F): number;
  path(history: H, frame: F): {trail: M[], progress: number[]};
  /** The width and the height of a board, in whatever unit, and what is played on, in short. */
  shape(frame: F): [number, number];
  place(level: string, frame: F): string;
  /** How much of what is to be discovered was, in words; without it nothing is. */
  shareText?(share: number): string;
  /** Where progress is discovery: the heading and the note of the positions from which a player's own page lets them
   * try again, each before moves that discovered nothing. Without it no position is looked for. */
  tries?: {title: string, note: string};
  /** The headline so far: its number, its unit, and 0..1 for a bar. */
  headline(frame: F): {value: string, unit: string, share: number};

  /** Sentences: of a frame in words with the rows of a board; of the task; below it; of the end. */
  inWords(frame: F, name: string): {line: string, rows: string[]};
  goal(frame: F | null): string;
  standing: string;
  /** What it means that a policy plays beside the player. */
  beside?(rival: string): string;
  /** An outcome in a word or two, "" while there is none; and as the state of a board. */
  outcome(outcome: string | null): string;
  status(outcome: string | null): string;
  ending(frame: F): {title: string, line: string};
  /** The same for a study; target: what the protocol asks for, in words. */
  trialEnding(frame: F, target: string): {title: string, line: string, figures: [string, string][], advice: string};
  compare(mine: F, theirs: F | null, rival: string): string;
  announcement(before: F | null, after: F): string;
  /** What the first moves of a visitor and of a participant are told. */
  hint(before: F, after: F, said: ReadonlySet<string>): Hint | null;
  coach(frame: F, keyOf: (action: Action) => string, target: string): [string, string];

  /** What lies ahead of a move after others that wait; what is to be heard after one. */
  ahead(frame: F, waiting: readonly Action[], action: Action): Ground;
  sound(before: F, after: F): Sound | null;
  /** The actions that may be chosen on a frame; null: all of them. Left out where it is always so. */
  allowed?(frame: F): readonly Action[] | null;

  /** A finished episode: its course, and the board after some of its moves. */
  courseOf(name: string, frames: F[]): C | null;
  boardAt(course: C, step: number): {frame: F, trail: M[]};
  progressAt(course: C, step: number): number;
  /** Draw over a board of a replay what the last move did. */
  paintEvents?(place: HTMLElement, course: C, step: number, look: Look): void;
  /** What Expert would do after some moves of a finished episode, in words. */
  adviceText?(advice: Answers.Advice, course: C, step: number): string;
  /** What the moves of a finished episode cost: above the list of mistakes, the list, and below it. */
  costsInWords?(costs: Answers.Costs): CostWords | Promise<CostWords>;
  /** The headline of an end beside another board, null where its own ending says more; `watched`
   * names who has driven, null for the player. */
  verdict?(mine: F, theirs: F | null, rival: string, watched: string | null): {title: string, line: string} | null;
  /** What is played until somebody chooses; null where the task leaves nothing to be chosen. */
  firstWish(policies: {name: string}[]): Play.Wish | null;
  /** Parts of the playground that this task alone has: a 3-D view before the first frame, the
   * rest after it. */
  parts?: {
    views(): Promise<typeof import("./mars/views.js")>,
    terrains(): Promise<typeof import("./mars/terrain_dialog.js")>,
    costs(): Promise<typeof import("./mars/costs.js")>,
  };
}
