// What the API answers and sockets carry, drawn from their own description: `make tables` draws it again.

declare namespace Admin {
  /** The newest entry of the chain of hashes. */
  type ChainHead = {
    /** in all */
    entries: number,
    /** SHA-256 (hex) of the newest; empty without any */
    head: string,
  };
  /** Whether the texts of the outcomes differ from before. */
  type ChangedTexts = {
    changed: boolean,
  };
  /** What SQLite's own check found. */
  type Check = {
    /** "ok", or what is damaged */
    result: string,
    is_whole: boolean,
    /** ms since 1970 */
    at_ms: number,
  };
  /** A name that a player chose. */
  type ChosenName = {
    name: string,
    /** an operator has hidden it */
    hidden: boolean,
    /** ms since 1970 */
    chosen_ms: number,
  };
  /** A study that was closed. */
  type ClosedStudy = {
    /** ms since 1970 */
    closed_ms: number | null,
  };
  /** A study as its operator sees it. */
  type ConsoleStudy = {
    outcomes: OutcomeText[],
    /** what is wrong with the file of the texts; empty if nothing is */
    outcomes_problem: string,
    /** null before anybody has joined */
    figure: LiveFigure | null,
    /** the commonest first */
    labels: LabelCount[],
    recruitment: "open" | "invitation" | "panel",
    /** of the day, for supervised play; null unless the study runs */
    code: string | null,
    /** ms since 1970 */
    code_until_ms: number | null,
    /** the oldest first */
    invitations: Invitation[],
    name: string,
    title: string,
    status: "open" | "secret kept" | "closed",
    /** ms since 1970 */
    frozen_ms: number,
    /** ms since 1970; null while it is open */
    closed_ms: number | null,
    task: Answers.Task,
    /** what is played, in words */
    where: string,
    /** moves after which an episode times out */
    max_steps: number,
    /** people that the protocol wants */
    planned: number,
    /** people who may agree at most; null: no limit */
    cap: number | null,
    /** of the cap; whoever agreed goes on, even if their place is free again */
    places_taken: number,
    /** practice episodes of each */
    warm_up: number,
    /** ranked episodes of each */
    ranked: number,
    stages: StageCount[],
    /** in the order of joining */
    participants: Participant[],
    exports: Exports,
    /** the server's time, ms since 1970 */
    now_ms: number,
  };
  /** The database. */
  type DatabaseFile = {
    /** of its file */
    name: string,
    /** bytes, without its log */
    size: number,
    /** bytes in its write-ahead log */
    wal_size: number,
  };
  /** How disk and database are. */
  type DatabaseHealth = {
    disk: Disk,
    database: DatabaseFile,
    /** ms since 1970 */
    last_write_ms: number,
    /** null while the first check is under way */
    check: Check | null,
    /** null if it cannot be read */
    chain: ChainHead | null,
  };
  /** The disk that the database is on. */
  type Disk = {
    /** bytes */
    free: number,
    /** bytes */
    total: number,
    is_low: boolean,
  };
  /** A report or a release that was asked for. */
  type Export = {
    state: "making" | "ready" | "failed",
    /** ms since 1970 */
    began_ms: number,
    /** why it failed */
    error: string | null,
    /** empty until they are ready */
    files: ExportFile[],
  };
  /** A file that was made. */
  type ExportFile = {
    name: string,
    /** bytes */
    size: number,
  };
  /** The newest report and the newest release; null before one is asked for. */
  type Exports = {
    report: Export | null,
    release: Export | null,
  };
  /** What an environment raised at the move that ended an episode. */
  type Failure = {
    episode: string,
    /** ms since 1970; null while its study's secret is kept */
    ended_ms: number | null,
    /** of the instance; null while its study's secret is kept */
    seed: number | null,
    /** step (not while its study's secret is kept), action, error and traceback */
    report: string,
  };
  /** A study in the server's folder, drafts and broken ones too. */
  type FolderStudy = {
    name: string,
    title: string,
    status: "draft" | "open" | "secret kept" | "closed" | "broken",
    /** what is wrong with a broken one */
    error: string | null,
  };
  /** What shows first that a server is overloaded. */
  type Gauges = {
    /** seconds that 99 of 100 moves took at most; 0 before the first */
    move_p99_seconds: number,
    /** ghosts, costs, exports and policies' episodes that wait */
    waiting_jobs: number,
    /** of the database */
    waiting_writes: number,
    /** seconds since the newest verified backup; -1 without */
    backup_age_seconds: number,
    /** since the server's start */
    backup_failures: number,
  };
  /** A player's name, and whether it is shown. */
  type HiddenName = {
    name: string,
    hidden: boolean,
  };
  /** An invitation to a study. */
  type Invitation = {
    id: string,
    state: "issued" | "opened" | "used" | "revoked",
    /** of the participant who came by it */
    label: string | null,
    /** of the link; null once it lets nobody in */
    token: string | null,
    /** ms since 1970 */
    issued_ms: number,
    /** ms since 1970 */
    revoked_ms: number | null,
    /** when it was opened or used, ms since 1970 */
    at_ms: number | null,
  };
  /** New invitations. */
  type IssuedInvitations = {
    /** each goes into a link: /study/NAME?invitation=TOKEN */
    tokens: string[],
  };
  /** A data-quality flag, and how often it was set. */
  type LabelCount = {
    label: string,
    /** 0 if it is of people, for the whole of their taking part */
    episodes: number,
    /** their labels */
    participants: string[],
  };
  /** A board that somebody plays now. */
  type LiveBoard = {
    session: string,
    /** null outside of studies */
    study: string | null,
    /** what its participant can quote */
    label: string | null,
    /** human or script */
    kind: string,
    /** of the study */
    phase: "tutorial" | "warm_up" | "ranked" | null,
    /** of the phase, from 0 */
    trial: number | null,
  };
  /** The people's estimate as it may be seen: nobody is in that of an open study. */
  type LiveFigure = {
    players: number,
    episodes: number,
    score: Answers.Interval | null,
    /** moves */
    steps: Answers.Interval | null,
    /** what it may be called */
    claim: string,
    /** whom it is of */
    set: string,
    everybody: Answers.StudyFigure,
    sentence: string,
  };
  /** Whether the operator is logged in. */
  type LoggedIn = {
    logged_in: boolean,
  };
  /** How taking part can end, and what people read then. */
  type OutcomeText = {
    /** finished, unfit_device, over_quota, no_consent, failed_questions, failed_practice, failed_attention, withdrew, left, stopped_by_us */
    outcome: string,
    /** who comes to it */
    words: string,
    /** what they read; empty without one */
    text: string,
  };
  /** Studies, boards that are played now, and the server's health. */
  type Overview = {
    studies: FolderStudy[],
    /** those of participants first */
    boards: LiveBoard[],
    health: ServerHealth,
    /** the newest first */
    names: ChosenName[],
    /** of environments, the newest first */
    failures: Failure[],
    /** the server's time, ms since 1970 */
    now_ms: number,
  };
  /** Somebody in a study, without anything that identifies them. */
  type Participant = {
    id: string,
    /** what the participant can quote */
    label: string,
    kind: "human" | "script",
    /** name of a bot */
    script: string | null,
    stage: "consent" | "instructions" | "tutorial" | "questions" | "warm_up" | "ranked" | "debrief" | "complete" | "withdrawn",
    /** ms since 1970 */
    joined_ms: number,
    /** from joining to the newest sign */
    minutes: number,
    /** loads of the page that have sent a key or what happened to the page */
    connections: number,
    /** has not finished, and sent nothing for half an hour */
    is_quiet: boolean,
    /** stage at which they withdrew */
    left_at: string | null,
    asks_erasure: boolean,
    /** null while they are hidden */
    deviations: number | null,
    /** signs of taking part twice */
    repeated: string[],
    /** episodes that are not attested, and why */
    not_attested: string[],
    /** to which they are assigned */
    arm: string | null,
    /** id of the invitation that brought them */
    invitation: string | null,
    /** when the operator's code was typed last, ms since 1970 */
    supervised_ms: number | null,
    /** practice episodes that ended */
    warm_up: number,
    /** ranked episodes that ended; null while they are hidden */
    ranked: number | null,
    /** over ranked episodes; null before the first, and hidden */
    mean_score: number | null,
    /** moves, over ranked episodes; null before the first, and hidden */
    mean_steps: number | null,
    /** how many ranked episodes ended with each outcome */
    outcomes: Record<string, number>,
  };
  /** Whom to pay. */
  type Payments = {
    columns: string[],
    /** a row for everybody who agreed, by `columns` */
    rows: string[][],
    /** the same as a file */
    csv: string,
    /** Prolific's lines of bonuses; null if they do not apply */
    bulk: string | null,
    /** what an hour was worth, a sentence; empty if unknown */
    effective_pay: string,
    /** people who have not agreed */
    without_consent: number,
  };
  /** Invitations that were taken back. */
  type RevokedInvitations = {
    /** their ids */
    revoked: string[],
  };
  /** How the server is. */
  type ServerHealth = {
    disk: Disk,
    database: DatabaseFile,
    /** ms since 1970 */
    last_write_ms: number,
    /** null while the first check is under way */
    check: Check | null,
    /** null if it cannot be read */
    chain: ChainHead | null,
    watched: Gauges,
    /** the largest first */
    owners: StorageOwner[],
    /** boards in memory */
    sessions: number,
    /** seconds since the start */
    up_s: number,
  };
  /** Who is at a stage of a study. */
  type StageCount = {
    stage: "consent" | "instructions" | "tutorial" | "questions" | "warm_up" | "ranked" | "debrief" | "complete" | "withdrawn",
    /** people */
    human: number,
    /** bots */
    script: number,
  };
  /** One of those for whom most is stored today. */
  type StorageOwner = {
    kind: "address" | "player" | "study",
    /** of a study; empty otherwise */
    name: string,
    /** stored today (UTC), or charged to open boards */
    bytes: number,
    /** bytes a day */
    budget: number,
  };
}
