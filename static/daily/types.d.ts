// What the modules of this folder hand on to each other, and what the server answers them.

declare namespace Daily {
  type Today = {
    day: string, commitment: string, now_ms: number, next_ms: number, attempt: Attempt | null, streak: number,
    calendar: Past[],
    yesterday: {day: string, commitment: string, key: string | null} | null,
  };
  type Past = {day: string, outcome: string, moves: number | null};
  type Results = {day: string, attempt: Attempt | null, people: People, policies: PolicyResult[]};
  type Attempt = {
    state: "open" | "ended", episode: string, outcome: string | null, moves: number, coverage: number | null,
    score: number | null, unranked: string | null,
  };
  type PolicyResult = {name: string, state: string, moves: number | null, coverage: number | null};
  type PolicyRow = {name: string, text: string, isReady: boolean, isBeaten: boolean};
  type PersonResult = {
    outcome: string, moves: number | null, coverage: number, you: boolean, rank: number, episode?: string,
  };
  type People = {
    players: number, unfinished: number, moves: [number, number][], table: PersonResult[], you: PersonResult | null,
  };
}
