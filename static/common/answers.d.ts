// What the API answers and sockets carry, drawn from their own description: `make tables` draws it again.

declare namespace Answers {
  /** What the expert would have done instead of a move. */
  type Advice = {
    /** of the actions in their order, 0..1, as a network finds them; null without one */
    shares: number[] | null,
    action: string,
    /** moves to the end after each action, if the expert plays on; null where it does not get there, or is not asked */
    after: (number | null)[] | null,
    /** moves from there to the end; null where it does not get there */
    needs: number | null,
    /** moves by which the move made lengthened the episode; below 0: a gain */
    cost: number,
  };
  /** The server answers. */
  type Alive = {
    status: "ok",
  };
  /** A player's attempt at a day's terrain. */
  type Attempt = {
    state: "open" | "ended",
    episode: string,
    outcome: string | null,
    /** made so far */
    moves: number,
    /** share of the cells, 0..1 */
    coverage: number | null,
    score: number | null,
    /** why an ended attempt has no rank */
    unranked: string | null,
  };
  /** Your best on a configuration. */
  type Best = {
    /** the configuration in words */
    place: string,
    max_steps: number,
    episodes: number,
    successes: number,
    /** the fewest moves on a terrain that was new to you */
    best: OwnEpisode | null,
    people: Standing,
  };
  /** A board with its running episode. */
  type Board = {
    /** cannot be guessed: whoever knows it can watch and drive */
    session: string,
    kind: "ranked" | "practice" | "challenge" | "watch" | "daily" | "study",
    /** the finished episode that is played against */
    challenges: string | null,
    /** "human", or a policy */
    player: string,
    task: Task,
    level: string,
    map: string | null,
    /** cells: one number for a square, or rows and columns */
    size: number | [number, number] | null,
    /** the day whose terrain it is */
    daily: string | null,
    /** whether the episode counts for the volunteers' figure so far */
    counts: boolean,
    /** once the episode has ended; null in a study */
    attestation: "unattested" | "spoilt" | "attested" | "supervised" | null,
    /** why it is not attested */
    not_attested: string | null,
    /** id of /watch/{watch}, where anybody may look on */
    watch: string | null,
    frame: Frame,
    rival: Rival | null,
  };
  /** What an attempt came to. */
  type CalendarDay = {
    day: string,
    outcome: string,
    /** null without a success */
    moves: number | null,
  };
  /** Somebody who succeeded on the terrain that a link challenged them to. */
  type Challenger = {
    /** null where none was chosen */
    name: string | null,
    moves: number,
  };
  /** What a participant agrees to. */
  type Consent = {
    version: string,
    /** paragraphs, split by blank lines */
    text: string,
  };
  /** An episode beside the expert's, and what its moves cost. Every length is in moves. */
  type Costs = {
    /** the expert's name */
    policy: string,
    /** why no move is judged; null where they are */
    reason: string | null,
    /** length of the episode: the limit where it did not succeed */
    counts: number,
    /** length of the expert's; null where its file is missing */
    expert_moves: number | null,
    /** moves more than the expert's */
    total: number | null,
    /** part of `total` that ending without success cost */
    given_up: number | null,
    /** moves that were better than the expert's saved, 0 or below */
    gained: number | null,
    /** cost of the mistakes of each kind */
    by_kind: Record<string, number>,
    /** the costliest first */
    mistakes: Mars.Mistake[],
    /** for each move; empty where none is judged */
    expert: Advice[],
  };
  /** How many episodes of a stage are over. */
  type Count = {
    done: number,
    of: number,
  };
  /** Mean coverage after some numbers of moves, 0..1, with its 95 % interval. */
  type CoverageCurve = {
    /** moves */
    steps: number[],
    mean: number[],
    /** empty for a single player or terrain */
    low: number[],
    /** empty for a single player or terrain */
    high: number[],
  };
  /** The terrain of a day (UTC). */
  type Day = {
    /** like 2026-11-22 */
    day: string,
    level: string,
    /** rows and columns, cells; null without a grid */
    size: [number, number] | null,
    /** canonical JSON for which the seed is drawn */
    protocol: string,
    /** SHA-256 of the day's key */
    commitment: string,
    /** null until the day is over */
    key: string | null,
    /** null until the day is over */
    seed: number | null,
    /** the nearest day before it with a terrain */
    older: string | null,
    /** the nearest day after it with a terrain, up to today */
    newer: string | null,
  };
  /** The participant's own figures, at the end. */
  type Debrief = {
    mean_score: number | null,
    mean_steps: number | null,
    episodes: RankedResult[],
    policy: DebriefPolicy | null,
    /** that can be shown again */
    warm_up_terrains: number,
    /** that can be shown again */
    ranked_terrains: number,
  };
  /** What the debrief's policy came to on the practice terrains. */
  type DebriefPolicy = {
    name: string,
    mean_steps_warm_up: number,
    /** the participant's */
    own_mean_steps_warm_up: number,
  };
  /** A participant's own episode, and the policy's on the same terrain. */
  type DebriefRuns = {
    own: Frame[],
    policy: PolicyRun,
  };
  /** What somebody reads who has come to an end. */
  type Ending = {
    /** finished, unfit_device, over_quota, no_consent, failed_questions, failed_practice, failed_attention, withdrew, left, stopped_by_us */
    outcome: string,
    /** for the place that sent them */
    code: string | null,
    /** that leads back there */
    address: string | null,
    sentence: string | null,
  };
  /** An ended episode with its moves. */
  type Episode = {
    episode: string,
    task: string,
    level: string,
    /** cells; absent without a grid of given size */
    rows?: number | null,
    /** cells; absent without a grid of given size */
    cols?: number | null,
    /** the environment's own configuration */
    config: Record<string, unknown>,
    /** the day whose terrain it was */
    daily: string | null,
    /** row and column */
    start: [number, number],
    /** null for a given terrain */
    seed: number | null,
    /** human, script or policy:NAME */
    driver: string,
    /** a policy played the same terrain on a second board */
    assisted: boolean,
    seed_chosen: boolean,
    terrain_met_before: boolean,
    /** for the volunteers' figure */
    counts: boolean,
    config_hash: string,
    core_version: string,
    /** server time, milliseconds since 1970 */
    started_ms: number,
    /** server time, milliseconds since 1970 */
    ended_ms: number,
    outcome: string,
    steps: number,
    discovered: number,
    score: number | null,
    attestation: "unattested" | "spoilt" | "attested" | "supervised" | null,
    attestation_reason: string | null,
    /** share of the cells, 0..1 */
    coverage: number | null,
    /** moves of a success, the limit for any other ending */
    steps_to_target: number | null,
    trajectory_hash: string,
    /** sum of the rewards */
    return: number,
    actions: string[],
    moves: Move[],
  };
  /** What the moves of an ended episode cost. */
  type EpisodeCosts = {
    /** the expert's name */
    policy: string,
    /** why no move is judged; null where they are */
    reason: string | null,
    /** length of the episode: the limit where it did not succeed */
    counts: number,
    /** length of the expert's; null where its file is missing */
    expert_moves: number | null,
    /** moves more than the expert's */
    total: number | null,
    /** part of `total` that ending without success cost */
    given_up: number | null,
    /** moves that were better than the expert's saved, 0 or below */
    gained: number | null,
    /** cost of the mistakes of each kind */
    by_kind: Record<string, number>,
    /** the costliest first */
    mistakes: Mars.Mistake[],
    /** for each move; empty where none is judged */
    expert: Advice[],
    episode: string,
  };
  /** How the server is. */
  type Health = {
    status: "ok" | "failing",
    /** why it is failing */
    detail?: string | null,
    /** why a board takes longer than a moment at first */
    getting_ready: string | null,
    /** what a recorded episode replays with */
    core_version: string,
    /** in memory */
    sessions: number,
    /** name of its file */
    database: string,
  };
  /** How well the volunteers of this playground play. */
  type HumanLevel = {
    /** the most played configuration first */
    figures: VolunteerFigure[],
    /** the same in words */
    sentence: string,
  };
  /** A mean with its 95 % interval. */
  type Interval = {
    mean: number,
    /** null without an interval, as for a single player */
    low: number | null,
    high: number | null,
  };
  /** People and policies on one entry. */
  type Leaderboard = {
    board: LeaderboardEntry,
    /** null without a mean of people */
    people: LeaderboardPeople | null,
    policies: LeaderboardPolicy[],
  };
  /** What people and policies are compared on: a closed study, or a configuration. */
  type LeaderboardEntry = {
    id: string,
    title: string,
    /** null for a configuration of the playground */
    study: string | null,
    /** the configuration in words */
    place: string,
    max_steps: number,
    config_hash: string,
    /** that policies play */
    terrains: number,
    players: number,
    episodes: number,
    /** null once there are means, and for a study */
    missing: MissingPlayers | null,
  };
  /** What people came to on an entry. */
  type LeaderboardPeople = {
    /** of a study: what its figure may be called */
    claim?: string | null,
    /** of a study: whom its estimate is of */
    set?: string | null,
    /** of a study: everybody who began */
    everybody?: StudyFigure | null,
    /** of the playground */
    abandoned?: number | null,
    /** of the playground */
    spoilt?: number | null,
    players: number,
    episodes: number,
    score: Interval,
    /** moves */
    steps: Interval,
    /** share of the episodes that succeeded, 0..1 */
    completed: number,
    curve: CoverageCurve | null,
    /** visits of each cell in a mean episode, by rows */
    visits: number[][] | null,
    trials: TrialFigure[],
  };
  /** A policy on an entry, with its figure once it is evaluated. */
  type LeaderboardPolicy = {
    name: string,
    summary: string,
    state: "ready" | "missing" | "waiting" | "computing" | "failed",
    /** episodes played */
    done: number,
    /** episodes in all */
    of: number,
    figure: PolicyFigure | null,
    /** null for a figure that was made here */
    shipped: Shipped | null,
    /** why it failed */
    error: string | null,
  };
  /** A level whose terrains are drawn from seeds. */
  type Level = {
    name: string,
    summary: string,
    topology: number | null,
    morphology: number | null,
    pays_bonus: boolean,
    /** a terrain of 21x21: a number a row, whose bit 0 is what blocks column 0 */
    example: number[],
  };
  /** An ended episode; docs/data.md says more of each field. */
  type ListedEpisode = {
    episode: string,
    task: string,
    level: string,
    /** cells; absent without a grid of given size */
    rows?: number | null,
    /** cells; absent without a grid of given size */
    cols?: number | null,
    /** the environment's own configuration */
    config: Record<string, unknown>,
    /** the day whose terrain it was */
    daily: string | null,
    /** row and column */
    start: [number, number],
    /** null for a given terrain */
    seed: number | null,
    /** human, script or policy:NAME */
    driver: string,
    /** a policy played the same terrain on a second board */
    assisted: boolean,
    seed_chosen: boolean,
    terrain_met_before: boolean,
    /** for the volunteers' figure */
    counts: boolean,
    config_hash: string,
    core_version: string,
    /** server time, milliseconds since 1970 */
    started_ms: number,
    /** server time, milliseconds since 1970 */
    ended_ms: number,
    outcome: string,
    steps: number,
    discovered: number,
    score: number | null,
    attestation: "unattested" | "spoilt" | "attested" | "supervised" | null,
    attestation_reason: string | null,
    /** share of the cells, 0..1 */
    coverage: number | null,
    /** moves of a success, the limit for any other ending */
    steps_to_target: number | null,
    trajectory_hash: string,
    /** sum of the rewards */
    return: number,
    actions: string[],
  };
  /** A study of this server. */
  type ListedStudy = {
    name: string,
    title: string,
    status: "open" | "secret kept" | "closed",
    /** invitation, panel or open */
    recruitment: string,
    /** practice episodes */
    warm_up: number,
    /** ranked episodes */
    ranked: number,
  };
  /** A map that the server was started with. */
  type Map = {
    name: string,
    summary: string,
    /** rows and columns, cells */
    size: [number, number],
  };
  /** Means over players, without intervals. */
  type Means = {
    score: number,
    /** moves of a success, the limit for any other ending */
    steps: number,
  };
  /** A figure of an ended episode. */
  type Metric = {
    name: string,
    unit: string,
    /** null without a bound */
    lowest: number | null,
    /** null without a bound */
    highest: number | null,
    is_better: "higher" | "lower",
  };
  /** What a mean of volunteers still needs. */
  type MissingPlayers = {
    /** who are missing */
    players: number,
    /** players that a mean needs */
    of: number,
    /** ranked episodes that each of them needs */
    episodes: number,
  };
  /** A move of an ended episode. Client times are of the page's own clock, in milliseconds. */
  type Move = {
    action: string,
    /** moves made before it */
    step: number,
    reward: number,
    discovered: number,
    /** server time, milliseconds since 1970 */
    server_ms: number,
    client_ms: number | null,
    key_down_ms: number | null,
    key_up_ms: number | null,
    input: "key" | "touch" | null,
    /** human, script or policy:NAME */
    driver: string,
  };
  /** An act that does not answer the current frame: nothing has changed. */
  type NotCurrent = {
    /** what was expected and what came */
    detail: string,
    /** the current one */
    frame: Frame,
  };
  /** A policy that can be watched or played against. */
  type Offer = {
    name: string,
    summary: string,
  };
  /** An ended episode of your own. */
  type OwnEpisode = {
    episode: string,
    kind: "daily" | "ranked" | "practice",
    /** whether it enters the volunteers' figures */
    counts: boolean,
    /** the day whose terrain it was */
    day: string | null,
    /** where it was played, in words */
    place: string,
    outcome: string,
    moves: number,
    /** share of the cells, 0..1 */
    coverage: number | null,
    score: number | null,
    /** server time, milliseconds since 1970 */
    ended_ms: number,
    /** why it is not attested */
    not_attested: string | null,
    /** whether the terrain was known from an earlier episode */
    met_before: boolean,
    /** Expert's on the same terrain, of ranked ones of the people's board that it finishes */
    expert_moves: number | null,
  };
  /** What you have driven. */
  type OwnHistory = {
    /** of these episodes, on whose terrains Expert has yet to drive */
    comparing: number,
    total: number,
    /** the newest first */
    episodes: OwnEpisode[],
    /** the most played configuration first */
    bests: Best[],
  };
  /** The name of whoever asks. */
  type OwnName = {
    name: string | null,
    /** an operator has hidden it */
    hidden: boolean,
  };
  /** Where whoever asks stands on the people's board. */
  type OwnStanding = {
    name: string | null,
    /** an operator has hidden it */
    hidden: boolean,
    /** null below `fewest` terrains */
    place: number | null,
    /** null before the first terrain */
    behind: number | null,
    /** null below `fewest` terrains */
    worse: number | null,
    terrains: number,
    /** terrains before there is a place */
    missing: number,
    /** yours on which Expert has not driven yet */
    comparing: number,
  };
  /** How a policy's session moves. */
  type Pace = {
    kind: "pace",
    mode: "follow" | "timed" | "paused",
    moves_per_second: number,
  };
  /** Where a participant stands. */
  type Participation = {
    study: string,
    title: string,
    /** in which the study is offered */
    languages: string[],
    task: Task,
    /** what the participant can quote */
    participant: string,
    stage: "consent" | "instructions" | "tutorial" | "questions" | "warm_up" | "ranked" | "debrief" | "complete" | "withdrawn",
    consent: Consent,
    questions: Question[],
    /** the study's own, below the task's; paragraphs split by blank lines */
    instructions: string,
    /** what stands beside the board; empty without one */
    hint: string,
    /** at the questions; null: as many as are wanted */
    tries_left: number | null,
    /** any or computer: with which people may take part */
    device: string,
    /** which of the answers just given were right */
    right: boolean[] | null,
    /** what explains the wrong ones */
    why: string[] | null,
    /** questions that come before anything else */
    block: ShownBlock | null,
    /** of this try at the practice */
    warm_up: Count,
    /** null if the warm-up need not come to anything */
    practice: Practice | null,
    ranked: Count,
    tutorial: Tutorial,
    break_due: boolean,
    /** whether leaving may ask for erasure */
    can_be_erased: boolean,
    pause_after_s: number,
    /** figures that the texts name */
    rules: Record<string, string>,
    session: string | null,
    about: Board | null,
    /** of the newest episode */
    phase: "tutorial" | "warm_up" | "ranked" | null,
    settings: Settings,
    debrief: Debrief | null,
    /** why the participant cannot go on, or what becomes of what was played */
    note: string | null,
    /** null while the participant can go on */
    ending: Ending | null,
    invited: boolean,
    supervised_until_ms: number | null,
    /** with which they can go on on another device; null before the consent and after leaving */
    recovery_code: string | null,
  };
  /** The people's board: the nearest to Expert first. */
  type People = {
    /** of the board's terrains */
    title: string,
    /** the first hundred */
    people: Person[],
    /** how many people have a place */
    ranked: number,
    /** terrains on which Expert has not driven yet */
    comparing: number,
    /** terrains from which on somebody has a place */
    fewest: number,
    /** moves that a terrain counts at most, and one that was not finished */
    most_behind: number,
    /** null without a cookie */
    you: OwnStanding | null,
  };
  /** What people came to on a day's terrain. */
  type PeopleOfDay = {
    players: number,
    /** without a success */
    unfinished: number,
    /** moves, and how many people needed as many */
    moves: [number, number][],
    table: Result[],
    you: Result | null,
  };
  /** Somebody on the people's board. */
  type Person = {
    place: number,
    /** null where none was chosen */
    name: string | null,
    /** mean moves more than Expert */
    behind: number,
    /** the worse end of its 95 % interval, by which people are ranked */
    worse: number,
    /** ranked ones that count */
    terrains: number,
    you: boolean,
  };
  /** Players and their ranked episodes that count. */
  type PlayerCounts = {
    players: number,
    episodes: number,
    abandoned: number,
    /** whose moves were not a person's own; they count as abandoned */
    spoilt: number,
  };
  /** What a policy came to on the terrains of an entry. */
  type PolicyFigure = {
    /** terrains */
    groups: number,
    episodes: number,
    score: Interval,
    /** moves */
    steps: Interval,
    /** share of the episodes that succeeded, 0..1 */
    completed: number,
    /** absent where nothing is discovered */
    curve?: CoverageCurve | null,
    /** visits of each cell in a mean episode, by rows; absent without a grid */
    visits?: number[][] | null,
  };
  /** What a policy came to on a day's terrain. */
  type PolicyOfDay = {
    name: string,
    state: "ready" | "waiting" | "computing" | "failed",
    moves: number | null,
    coverage: number | null,
  };
  /** A policy's episode on a terrain of a study. */
  type PolicyRun = {
    name: string,
    frames: Frame[],
  };
  /** What the warm-up must come to before the first ranked episode. */
  type Practice = {
    /** for the participant */
    text: string,
    /** of the try, from 1 */
    number: number,
    tries: number,
  };
  /** Why a request was refused or failed. */
  type Problem = {
    /** what was expected and what came */
    detail: string,
  };
  /** A position in which one first move is clearly better than each other. */
  type Puzzle = {
    id: string,
    frame: Frame,
    /** the way here, row and column after each move */
    trail: [number, number][],
    /** those to choose from */
    moves: string[],
  };
  /** The best first move of a puzzle, and what it saves against the next best. */
  type PuzzleAnswer = {
    best: string,
    /** moves to the goal on average, by the first move */
    means: Record<string, number>,
    /** moves on average */
    saves: number,
    /** its standard error, moves */
    error: number,
    /** that agree with what is seen, over which it is the average */
    terrains: number,
    /** moves that it saves on the terrain itself */
    here: number,
    /** rows and columns that come in sight there within eight moves, by the first move */
    shows: Record<string, [number, number][]>,
  };
  /** The puzzles of today (UTC), the same for everybody. */
  type Puzzles = {
    /** like 2026-11-22 */
    day: string,
    /** server time, milliseconds since 1970 */
    now_ms: number,
    /** when the next day begins */
    next_ms: number,
    puzzles: Puzzle[],
  };
  /** A question that shows whether the instructions were understood. */
  type Question = {
    question: string,
    choices: string[],
  };
  /** A ranked episode of the participant's. */
  type RankedResult = {
    /** from 0 */
    trial: number,
    outcome: string,
    steps: number,
    score: number,
  };
  /** An ended episode as its replay draws it. No seed, no player and no session is in it. */
  type Replay = {
    episode: string,
    /** where it was played, in words */
    place: string,
    task: Task,
    /** the episode's own course */
    run: Course,
    /** policies that can be shown beside it */
    ghosts: string[],
    /** the policy that is shown where none is named */
    preferred: string | null,
  };
  /** A person's row of a day's table. */
  type Result = {
    /** absent until the day is over */
    episode?: string | null,
    outcome: string,
    /** null without a success */
    moves: number | null,
    /** share of the cells, 0..1; null where nothing is discovered */
    coverage: number | null,
    you: boolean,
    rank: number,
  };
  /** People and policies on the terrain of a day. */
  type Results = {
    day: string,
    attempt: Attempt | null,
    people: PeopleOfDay,
    /** the best first */
    policies: PolicyOfDay[],
  };
  /** The policy that plays the same terrain beside you. */
  type Rival = {
    session: string,
    policy: string,
    pace: Pace | null,
    frame: Frame,
  };
  /** What the participant chose. */
  type Settings = {
    modality: "keyboard" | "touch" | null,
    palette: "standard" | "colour-blind" | "high-contrast",
    keys: Record<string, string[]> | null,
    /** null if the study is offered in one alone */
    language: string | null,
  };
  /** Where a figure comes from that came with the package. */
  type Shipped = {
    /** that made it */
    command: string,
  };
  /** Questions on one screen. */
  type ShownBlock = {
    name: string,
    /** ranked episodes done, between sets; else 0 */
    turn: number,
    title: string,
    intro: string,
    can_be_skipped: boolean,
    questions: ShownQuestion[],
  };
  /** A choice, at the place where it is shown. */
  type ShownChoice = {
    /** what is sent for it */
    value: number,
    text: string,
  };
  /** A question of a block; a field that its kind lacks is absent. */
  type ShownQuestion = {
    kind: "choice" | "several" | "likert" | "scale" | "number" | "text" | "statement",
    name: string,
    question: string,
    /** it cannot be left out */
    needed: boolean,
    /** prefer not to say is offered: null is sent for it */
    declinable: boolean,
    /** of choice and several */
    choices?: ShownChoice[] | null,
    /** of likert: the statements */
    rows?: string[] | null,
    /** of likert: from one end to the other */
    points?: string[] | null,
    /** of scale: 0 to one less is sent */
    steps?: number | null,
    /** of scale: its low end */
    low?: string | null,
    /** of scale: its high end */
    high?: string | null,
    /** of number */
    minimum?: number | null,
    /** of number */
    maximum?: number | null,
    /** of text: its characters at most */
    max_length?: number | null,
    /** of number */
    whole?: boolean | null,
    /** of number */
    unit?: string | null,
    /** of text: several lines */
    long?: boolean | null,
  };
  /** Your ranked episodes among the volunteers'. */
  type Standing = {
    /** mean moves of the volunteers with enough episodes, sorted */
    means: number[],
    /** your own mean; null while episodes are missing */
    you: number | null,
    /** your ranked episodes that count */
    ranked: number,
    /** how many more you need for a place */
    missing: number,
  };
  /** What a study has published. */
  type Study = {
    name: string,
    title: string,
    status: "open" | "secret kept" | "closed",
    protocol_hash: string,
    /** SHA-256 of the secret */
    commitment: string,
    /** null until the study is closed */
    secret: string | null,
    task: Task,
    level: string,
    /** cells; absent without a grid of given size */
    rows?: number | null,
    /** cells; absent without a grid of given size */
    cols?: number | null,
    /** the environment's own configuration */
    config: Record<string, unknown>,
    warm_up: number,
    ranked: number,
    players: number,
    consent_version: string,
  };
  /** An estimate of people in a study. */
  type StudyFigure = {
    players: number,
    episodes: number,
    score: Interval | null,
    /** moves */
    steps: Interval | null,
  };
  /** What is played. */
  type Task = {
    name: string,
    title: string,
    /** what players are told; "" if the page says it */
    instructions: string,
    /** folder of `static/task` that draws it */
    assets: string,
    /** names, by their codes */
    actions: string[],
    /** default keys of each action (`event.code`) */
    keys: Record<string, string[]>,
    /** frames a second where time runs; null where each move is waited for */
    clock: number | null,
    /** the headline first */
    metrics: Metric[],
    /** outcomes that are successes */
    successes: string[],
    /** policy that moves are compared with; null without one */
    expert: string | null,
    /** whether it has a daily instance and a leaderboard */
    has_boards: boolean,
  };
  /** What leads to a participant's place from another device. */
  type Ticket = {
    /** the page's address, and the place's token after #go= */
    link: string,
    until_ms: number,
    /** rows of the link's QR code, a character a module: 1 is dark */
    qr: string[],
  };
  /** Today's terrain and your attempt at it. */
  type Today = {
    /** like 2026-11-22 */
    day: string,
    level: string,
    /** rows and columns, cells; null without a grid */
    size: [number, number] | null,
    /** canonical JSON for which the seed is drawn */
    protocol: string,
    /** SHA-256 of the day's key */
    commitment: string,
    /** null until the day is over */
    key: string | null,
    /** null until the day is over */
    seed: number | null,
    /** the nearest day before it with a terrain */
    older: string | null,
    /** the nearest day after it with a terrain, up to today */
    newer: string | null,
    /** server time, milliseconds since 1970 */
    now_ms: number,
    /** when the next day begins */
    next_ms: number,
    max_steps: number,
    attempt: Attempt | null,
    /** people whose attempt of today is over and has a rank */
    players: number,
    /** days in a row on which you came to the end */
    streak: number,
    /** attempts that are over */
    played: number,
    /** your newest attempts, the oldest first */
    calendar: CalendarDay[],
    yesterday: Day | null,
  };
  /** The means of everybody's first, second, ... episode. */
  type TrialFigure = {
    /** from 1 */
    trial: number,
    players: number,
    score: Interval,
    /** moves */
    steps: Interval,
  };
  /** Whether the tutorial is over. */
  type Tutorial = {
    done: boolean,
  };
  /** The figure of the volunteers on one configuration. `players` and the counts beside it are of all. */
  type VolunteerFigure = {
    players: number,
    episodes: number,
    abandoned: number,
    /** whose moves were not a person's own; they count as abandoned */
    spoilt: number,
    task: string,
    level: string,
    /** the configuration in words */
    where: string,
    /** cells; absent without a grid of given size */
    rows?: number | null,
    /** cells; absent without a grid of given size */
    cols?: number | null,
    config_hash: string,
    /** the environment's own configuration */
    config: Record<string, unknown>,
    population: "volunteers",
    /** who are in the means: those with enough ranked episodes */
    entering: PlayerCounts,
    /** null once there are means */
    missing: MissingPlayers | null,
    /** with spoilt episodes as they were played; null without any */
    as_played: Means | null,
    /** null while players are missing */
    score: Interval | null,
    /** moves; null while players are missing */
    steps: Interval | null,
    /** share of the episodes that succeeded, 0..1 */
    completed: number | null,
  };
  /** An episode that anybody with its link can watch. */
  type Watched = {
    episode: string,
    /** "you", "human", "script", or a policy */
    player: string,
    task: Task,
    level: string,
    /** cells: one number for a square, or rows and columns */
    size: number | [number, number] | null,
    frame: Frame,
    history: MoveHistory,
    /** every frame, once it has ended */
    frames: Frame[] | null,
  };
}

declare namespace Socket {
  /** One move. It is made only on the current `episode` and `step`, so a repeat is harmless. */
  type Act = {
    kind?: "act",
    /** `episode` of the frame the move answers */
    episode: string,
    /** `step` of that frame: the number of moves made so far */
    step: number,
    /** the name of an action */
    action: string,
    /** the page's trusted event, if any */
    input?: "key" | "touch" | null,
    /** when the key went down, client clock */
    key_down_ms?: number | null,
    /** when the last key came up, client clock */
    key_up_ms?: number | null,
    /** when the move was sent, client clock */
    client_ms?: number | null,
  };
  /** Whether time runs on a board with a clock. It stands until the page sends a `resume`, counts down `ms`, or runs. */
  type ClockState = {
    kind: "clock",
    episode: string,
    state: "standing" | "countdown" | "running",
    /** of the countdown */
    ms: number,
    /** why it stands, where that is not the page's doing */
    reason: string | null,
    /** of `reason` in the page's texts */
    ident: string | null,
    /** of its placeholders */
    values: Record<string, string> | null,
  };
  /** The answer to `Events`: all are stored, or none. None with a reason is final; none without a reason means send them again. */
  type EventsAnswer = {
    kind: "kept",
    episode: string,
    count: number,
    reason: string | null,
  };
  /** One key press, touch, or change of focus, as the page saw it. */
  type InputEvent = {
    kind: "keydown" | "keyup" | "touchdown" | "touchup" | "focus" | "blur" | "visible" | "hidden" | "pause" | "resume",
    /** `event.code` of a key */
    code?: string | null,
    repeat?: boolean | null,
    /** `event.isTrusted` */
    trusted?: boolean | null,
    /** monotonic client clock */
    client_ms: number,
    /** `step` of the frame on screen */
    step?: number | null,
    /** from the last move to its frame */
    round_trip_ms?: number | null,
  };
  /** How many of a running episode's moves a lost environment has repeated. The next frame ends it. */
  type RepeatProgress = {
    kind: "remade",
    episode: string,
    done: number,
    of: number,
  };
}
