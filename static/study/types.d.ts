// What the modules of this folder hand on to each other; what the API answers is drawn in common/answers.d.ts.

declare namespace Study {
  type Stage = "consent" | "instructions" | "tutorial" | "questions" | "warm_up" | "ranked" | "debrief"
    | "complete" | "withdrawn";
  /** What is sent for a question of a block; null: prefer not to say. */
  type Sent = null | boolean | number | string | (number | null)[];
  type Kind = {
    draw(question: Answers.ShownQuestion, sent: Sent | undefined): HTMLElement[],
    read(question: Answers.ShownQuestion, root: HTMLElement): Sent | undefined,
  };
  type Phase = "tutorial" | "warm_up" | "ranked";
  type PaletteName = "standard" | "colour-blind" | "high-contrast";
  type Settings = {modality: "keyboard" | "touch", palette: PaletteName, keys: Keys};
  /** What the server says of a participant, with the task as the page plays it: the answer to every request but `show` and
   * `terrain`. */
  type Participant = Omit<Answers.Participation, "task" | "about"> & {task: Task, about: About | null};
  /** The phase of a terrain. */
  type Shown = "warm_up" | "ranked";
  /** Of navigator.keyboard, where a browser has it. */
  type Layout = {get: (code: string) => string | undefined};
  type Palette = {title: string, hint: string, inks: Inks};
  /** Of the palette in force. */
  type Look = {palette: PaletteName, inks: Inks, accent: string, rival: string, font: string};
  type Choices = Settings & {pad: boolean};
  type Replay = {index: number, runs: {own: Course | null, policy: Course | null}, playback: Playback};
  type Screen = "loading" | "problem" | "block" | "ready" | "break" | "play" | "consent" | "instructions" | "questions"
    | "debrief" | "complete" | "withdrawn";
  /** Game: the board, the connection and the notices: the playground's own state without a rival; problem: one sentence when
   * the study cannot be taken part in; passed: the finished episode whose end card was passed by; isPaused: the board waits
   * for a key; replay: the debrief's, null until one is loaded; looksBack: whoever has finished looks at the debrief again. */
  type State = {
    game: GameState, participant: Participant | null, problem: string | null, passed: string | null, isPaused: boolean,
    replay: Replay | null, looksBack: boolean,
  };
  type Event = GameEvent | {kind: "participant", participant: Participant} | {kind: "problem", text: string}
    | {kind: "passed", episode: string} | {kind: "paused", isPaused: boolean} | {kind: "replay-moved", replay: Replay}
    | {kind: "looked-back", looksBack: boolean};
  type Asked = Promise<Participant>;
  type Api = {
    show(): Promise<Answers.Study>,
    join(outside_ids: Record<string, string | string[]>, invitation: string | null): Asked, me(): Asked,
    consent(version: string, agree: boolean, unfit?: boolean): Asked, advance(from: Stage): Asked, answers(answers: number[]): Asked,
    block(block: string, turn: number, answers: Record<string, Sent>): Asked, skip(block: string, turn: number): Asked,
    next(): Asked, giveUp(episode: string, step: number): Asked,
    /** The request outlives the page; the signal ends it. */
    settings(settings: (Settings & {stage: string | undefined}) | {language: string}, signal?: AbortSignal): Asked, supervise(code: string): Asked, withdraw(erase: boolean): Asked,
    elsewhere(page: string): Promise<Answers.Ticket>, goOn(brings: {token: string} | {code: string}): Asked,
    terrain(index: number, phase: Shown): Promise<Answers.DebriefRuns>, costs(index: number, phase: Shown): Promise<Answers.Costs>,
  };
}
