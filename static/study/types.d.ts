// What the modules of this folder hand on to each other, and what the server answers them.

declare namespace Study {
  type Stage = "consent" | "instructions" | "tutorial" | "questions" | "warm_up" | "ranked" | "debrief"
    | "complete" | "withdrawn";
  type Phase = "tutorial" | "warm_up" | "ranked";
  /** What GET debrief/{index} answers. */
  type Runs = {own: Frame[], policy: {name: string, frames: Frame[]}};
  type PaletteName = "mars" | "colour-blind" | "high-contrast";
  type Settings = {modality: "keyboard" | "touch", palette: PaletteName, keys: Keys};
  /** Own figures and codes; null before the debrief. */
  type Debrief = {
    mean_score: number | null, mean_steps: number | null,
    episodes: {trial: number, outcome: string, steps: number, score: number}[],
    policy: {name: string, mean_steps_warm_up: number | null, own_mean_steps_warm_up: number | null} | null,
    warm_up_terrains: number, ranked_terrains: number, completion_code: string | null, return_url: string | null,
  };
  /** What the server says of a participant: the answer to every request but `show` and `terrain`. note: why nobody can
   * go on here, or what is kept of one who left. */
  type Participant = {
    study: string, title: string, participant: string, stage: Stage, consent: {version: string, text: string},
    questions: {question: string, choices: string[]}[], right: boolean[] | null, why?: string[] | null,
    warm_up: {done: number, of: number}, ranked: {done: number, of: number}, tutorial: {done: boolean},
    break_due: boolean, can_be_erased: boolean, pause_after_s: number, rules: Record<string, string>,
    session: string | null, about: About | null, phase: Phase | null,
    settings: {modality?: Settings["modality"] | null, palette?: PaletteName | null, keys?: Keys | null},
    debrief: Debrief | null, note?: string | null, invited: boolean, supervised_until_ms: number | null, task: Task,
  };
  /** The phase of a terrain. */
  type Shown = "warm_up" | "ranked";
  /** Of navigator.keyboard, where a browser has it. */
  type Layout = {get: (code: string) => string | undefined};
  type Palette = {title: string, hint: string, inks: Inks};
  /** Of the palette in force. */
  type Look = {palette: PaletteName, inks: Inks, accent: string, rival: string, font: string};
  type Choices = Settings & {pad: boolean};
  type Replay = {index: number, runs: {own: Course | null, policy: Course | null}, playback: Playback};
  type Screen = "loading" | "problem" | "ready" | "break" | "play" | "consent" | "instructions" | "questions"
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
    show(): Promise<{status: "open" | "secret kept" | "closed", rows: number, cols: number}>,
    join(outside_ids: Record<string, string>, invitation: string | null): Asked, me(): Asked,
    consent(version: string, agree: boolean): Asked, advance(from: Stage): Asked, answers(answers: number[]): Asked,
    next(): Asked, giveUp(episode: string, step: number): Asked,
    /** The request outlives the page; the signal ends it. */
    settings(settings: Settings, signal: AbortSignal): Asked, supervise(code: string): Asked, withdraw(erase: boolean): Asked,
    terrain(index: number, phase: Shown): Promise<Runs>, costs(index: number, phase: Shown): Promise<Mars.Costs>,
  };
}
