// What the modules of this folder hand on to each other, and what the server answers them.

declare namespace Admin {
  type BoardInfo = {
    session: string, study: string | null, label: string | null, kind: string, phase: string | null,
    trial: number | null, level: string, task?: Answers.Task,
  };
  type Watched = {
    figure: HTMLElement, canvas: HTMLCanvasElement, board: Board | null, task: Task | null,
    link: ReturnType<typeof import("../common/socket.js").follow>, info: BoardInfo,
  };
  type Listed = {name: string, title: string, status: string, error: string | null};
  type Overview = {
    studies: Listed[], boards: BoardInfo[], health: Health, now_ms: number,
    names: {name: string, chosen_ms: number, hidden: boolean}[],
  };
  type Stage = {stage: string, human: number, script: number};
  type Participant = {
    id: string, label: string, kind: "human" | "script", script: string | null, stage: string, joined_ms: number,
    minutes: number, is_quiet: boolean, left_at: string | null, asks_erasure: boolean, deviations: number | null, repeated: string[], not_attested: string[],
    invitation: string | null, supervised_ms: number | null, warm_up: number, ranked: number | null, mean_score: number | null,
    mean_steps: number | null, outcomes: Record<string, number>,
  };
  type Invitation = {
    id: string, state: "issued" | "opened" | "used" | "revoked", issued_ms: number, revoked_ms: number | null,
    label: string | null, at_ms: number | null, token: string | null,
  };
  type Figure = {
    players: number, episodes: number, score: Answers.Interval | null, steps: Answers.Interval | null, set: string, sentence: string,
  };
  type Export = {
    state: "making" | "ready" | "failed", began_ms: number, error: string | null, files: {name: string, size: number}[],
  };
  type Study = {
    name: string, title: string, status: "open" | "secret kept" | "closed", frozen_ms: number, closed_ms: number | null, level: string,
    where: string, max_steps: number, planned: number, warm_up: number, ranked: number, stages: Stage[],
    participants: Participant[], figure: Figure | null,
    labels: {label: string, episodes: number, participants: string[]}[],
    exports: {report: Export | null, release: Export | null}, recruitment: "invitation" | "panel" | "open",
    code: string | null, code_until_ms: number | null, invitations: Invitation[], now_ms: number,
    outcomes: {outcome: string, words: string, text: string}[],
    task?: Answers.Task,
  };
  type Payments = {
    columns: string[], rows: string[][], csv: string, bulk: string | null, effective_pay: string, without_consent: number,
  };
  type Health = {
    disk: {free: number, total: number, is_low: boolean}, database: {name: string, size: number, wal_size: number},
    last_write_ms: number, check: {result: string, is_whole: boolean, at_ms: number} | null,
    chain: {entries: number, head: string} | null, sessions: number, up_s: number,
    watched: Record<"move_p99_seconds" | "waiting_jobs" | "waiting_writes" | "backup_age_seconds" | "backup_failures", number>,
    owners: {kind: "address" | "player" | "study", name: string, bytes: number, budget: number}[],
  };
}
