"""The tables of a database, all of them, as one script. Times are milliseconds since 1970 (UTC), ids are texts.

Every table is STRICT: a value of another type than its column's is refused. `app.storage.chain` says which columns the chain
of hashes covers.
"""

SCHEMA = 1
"""The number of this schema, which stands in the file as `user_version`."""

TABLES = """
-- Facts about the database itself by name, such as the key that signs cookies.
CREATE TABLE meta (name TEXT PRIMARY KEY, value TEXT NOT NULL) STRICT;

-- What is played.

CREATE TABLE players (id TEXT PRIMARY KEY, created_ms INTEGER NOT NULL) STRICT;

CREATE TABLE sessions (
    id TEXT PRIMARY KEY,
    player_id TEXT REFERENCES players(id),
    owner_id TEXT REFERENCES players(id), -- the player at whose screen it runs: a rival's is its player's
    driver_name TEXT NOT NULL,
    rival_of TEXT REFERENCES sessions(id),
    pace_mode TEXT NOT NULL CHECK (pace_mode IN ('follow', 'timed', 'paused')),
    moves_per_second REAL NOT NULL,
    created_ms INTEGER NOT NULL,
    control TEXT NOT NULL CHECK (control IN ('cookie', 'bearer')) -- moved by its player's cookie, or by who knows its id
) STRICT;
CREATE INDEX sessions_by_owner ON sessions (owner_id);
CREATE INDEX sessions_by_rival ON sessions (rival_of) WHERE rival_of IS NOT NULL;

CREATE TABLE episodes (
    id TEXT PRIMARY KEY,
    session_id TEXT NOT NULL REFERENCES sessions(id),
    number INTEGER NOT NULL,
    level TEXT NOT NULL,
    config TEXT NOT NULL, -- JSON
    config_hash TEXT NOT NULL,
    seed INTEGER,
    seed_chosen INTEGER NOT NULL CHECK (seed_chosen IN (0, 1)),
    terrain BLOB NOT NULL,
    terrain_hash TEXT NOT NULL,
    terrain_met_before INTEGER NOT NULL CHECK (terrain_met_before IN (0, 1)),
    start_row INTEGER NOT NULL,
    start_col INTEGER NOT NULL,
    policy_seed INTEGER NOT NULL,
    core_version TEXT NOT NULL,
    driver TEXT NOT NULL CHECK (driver IN ('human', 'script') OR driver LIKE 'policy:%'),
    assisted INTEGER NOT NULL CHECK (assisted IN (0, 1)),
    started_ms INTEGER NOT NULL,
    ended_ms INTEGER, -- from here on all are null while it runs
    outcome TEXT,
    steps INTEGER,
    discovered INTEGER,
    total REAL,
    score REAL,
    trajectory_hash TEXT,
    attestation TEXT CHECK (attestation IN ('unattested', 'declared', 'attested', 'supervised')), -- of a person's alone
    attestation_reason TEXT, -- why it is not attested
    UNIQUE (session_id, number),
    CHECK ((ended_ms IS NULL) = (outcome IS NULL)),
    CHECK ((ended_ms IS NULL) = (trajectory_hash IS NULL))
) STRICT;
CREATE INDEX episodes_by_terrain ON episodes (terrain_hash);
CREATE INDEX episodes_by_end ON episodes (ended_ms);

CREATE TABLE steps (
    episode_id TEXT NOT NULL REFERENCES episodes(id),
    step INTEGER NOT NULL,
    action INTEGER NOT NULL CHECK (action BETWEEN 0 AND 3),
    reward REAL NOT NULL,
    discovered INTEGER NOT NULL,
    server_ms INTEGER NOT NULL,
    client_ms REAL,
    key_down_ms REAL,
    key_up_ms REAL,
    input TEXT CHECK (input IN ('key', 'touch')),
    driver TEXT NOT NULL,
    PRIMARY KEY (episode_id, step)
) STRICT, WITHOUT ROWID;

CREATE TABLE input_events (
    episode_id TEXT NOT NULL REFERENCES episodes(id),
    number INTEGER NOT NULL,
    kind TEXT NOT NULL,
    code TEXT,
    repeat INTEGER,
    trusted INTEGER,
    client_ms REAL NOT NULL,
    step INTEGER,
    round_trip_ms REAL,
    server_ms INTEGER NOT NULL,
    PRIMARY KEY (episode_id, number)
) STRICT, WITHOUT ROWID;

-- The batches in which input events came: one that comes again is known by its id, without a look at its events.
CREATE TABLE event_batches (
    episode_id TEXT NOT NULL REFERENCES episodes(id),
    first INTEGER NOT NULL, -- number of its first event
    batch TEXT NOT NULL, -- the id that the page drew
    PRIMARY KEY (episode_id, first),
    UNIQUE (episode_id, batch)
) STRICT, WITHOUT ROWID;

-- The terrain of a day (UTC). Its key is told to nobody before the day is over.
CREATE TABLE daily_terrains (
    commitment TEXT PRIMARY KEY, -- SHA-256 (hex) of the key, shown from the start of the day on
    day TEXT NOT NULL CHECK (day GLOB '[0-9][0-9][0-9][0-9]-[0-9][0-9]-[0-9][0-9]'),
    key TEXT NOT NULL,
    config TEXT NOT NULL -- JSON
) STRICT;
CREATE INDEX daily_terrains_by_day ON daily_terrains (day);

-- Who has played which day's terrain: each player once.
CREATE TABLE daily_attempts (
    episode_id TEXT PRIMARY KEY REFERENCES episodes(id),
    day TEXT NOT NULL,
    player_id TEXT NOT NULL REFERENCES players(id),
    commitment TEXT NOT NULL REFERENCES daily_terrains(commitment),
    UNIQUE (day, player_id)
) STRICT;

-- Studies.

-- Written on the first join; closed_ms and secret when the study is closed.
CREATE TABLE studies (
    name TEXT PRIMARY KEY,
    protocol TEXT NOT NULL, -- JSON
    protocol_hash TEXT NOT NULL,
    commitment TEXT NOT NULL,
    frozen_ms INTEGER NOT NULL,
    closed_ms INTEGER,
    secret TEXT
) STRICT;

CREATE TABLE participants (
    id TEXT PRIMARY KEY,
    study TEXT NOT NULL REFERENCES studies(name),
    player_id TEXT NOT NULL REFERENCES players(id),
    session_id TEXT REFERENCES sessions(id),
    kind TEXT NOT NULL CHECK (kind IN ('human', 'script')),
    script TEXT, -- of kind script: what plays
    stage TEXT NOT NULL CHECK (stage IN (
        'consent', 'instructions', 'tutorial', 'questions', 'warm_up', 'ranked', 'debrief', 'complete', 'withdrawn')),
    consent_version TEXT,
    consent_ms INTEGER,
    joined_ms INTEGER NOT NULL,
    completed_ms INTEGER,
    completion_code TEXT,
    settings TEXT NOT NULL, -- JSON
    invitation TEXT, -- id of the invitation that brought them
    supervised_ms INTEGER, -- when the operator's code was typed last
    UNIQUE (study, player_id)
) STRICT;
CREATE INDEX participants_by_session ON participants (session_id);
CREATE INDEX participants_by_player ON participants (player_id);
CREATE INDEX participants_by_invitation ON participants (study, invitation) WHERE invitation IS NOT NULL;

-- Who somebody is elsewhere: never exported, never joined by a reader that exports.
CREATE TABLE identities (
    participant_id TEXT NOT NULL REFERENCES participants(id),
    name TEXT NOT NULL,
    value TEXT NOT NULL,
    PRIMARY KEY (participant_id, name)
) STRICT;
CREATE INDEX identities_by_value ON identities (name, value);

CREATE TABLE stage_events (
    participant_id TEXT NOT NULL REFERENCES participants(id),
    number INTEGER NOT NULL,
    at_ms INTEGER NOT NULL,
    kind TEXT NOT NULL,
    detail TEXT NOT NULL, -- JSON
    PRIMARY KEY (participant_id, number)
) STRICT;

CREATE TABLE study_episodes (
    episode_id TEXT PRIMARY KEY REFERENCES episodes(id),
    participant_id TEXT NOT NULL REFERENCES participants(id),
    phase TEXT NOT NULL CHECK (phase IN ('tutorial', 'warm_up', 'ranked')),
    trial INTEGER NOT NULL, -- counts in the order played
    terrain INTEGER NOT NULL, -- index of its seed
    UNIQUE (participant_id, phase, trial)
) STRICT;

-- What was published; outdated_ms is set when a participant in it was forgotten.
CREATE TABLE releases (
    study TEXT NOT NULL REFERENCES studies(name),
    version INTEGER NOT NULL,
    manifest_hash TEXT NOT NULL,
    released_ms INTEGER NOT NULL,
    outdated_ms INTEGER,
    PRIMARY KEY (study, version, manifest_hash)
) STRICT;

-- Hashes of trajectories and of people that were erased: merges and imports leave them out.
CREATE TABLE forgotten (trajectory_hash TEXT PRIMARY KEY, forgotten_ms INTEGER NOT NULL) STRICT;
CREATE TABLE forgotten_people (id_hash TEXT PRIMARY KEY, forgotten_ms INTEGER NOT NULL) STRICT;

-- The chain of salted hashes, one entry after the other.

CREATE TABLE chain (
    number INTEGER PRIMARY KEY,
    day_ms INTEGER NOT NULL,
    kind TEXT NOT NULL CHECK (kind IN ('study', 'session', 'episode', 'events', 'participant', 'forgotten', 'merged')),
    is_sound INTEGER NOT NULL CHECK (is_sound IN (0, 1)), -- 0: found not to fit its rows
    replaces INTEGER, -- the number of the entry of the same thing before it
    hash TEXT NOT NULL,
    note TEXT, -- of kinds forgotten and merged
    head TEXT NOT NULL
) STRICT;

-- What the latest entries stand for, with their salts and salted hashes by table; gone once somebody is forgotten.
CREATE TABLE chain_salts (
    kind TEXT NOT NULL,
    id TEXT NOT NULL,
    first INTEGER NOT NULL, -- of kind events: the number of the first event, else 0
    number INTEGER NOT NULL UNIQUE,
    salt BLOB NOT NULL,
    parts TEXT NOT NULL, -- JSON
    PRIMARY KEY (kind, id, first)
) STRICT, WITHOUT ROWID;

-- Operators.

CREATE TABLE operators (name TEXT PRIMARY KEY, password_hash TEXT NOT NULL, created_ms INTEGER NOT NULL) STRICT;

-- What operators did; status is that of the answer, null until there is one.
CREATE TABLE operator_actions (
    number INTEGER PRIMARY KEY,
    at_ms INTEGER NOT NULL,
    operator TEXT NOT NULL,
    action TEXT NOT NULL,
    study TEXT,
    status INTEGER
) STRICT;
"""
