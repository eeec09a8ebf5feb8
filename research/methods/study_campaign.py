"""What cheating in a study gains: `python -m research.methods.study_campaign`."""

from __future__ import annotations

import html
import random
import re
import shutil
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click
import numpy as np

from humanplay.board.attestation import FIRST_MOVES
from humanplay.command.console import progress as progress_bar
from humanplay.db.erasure import forget
from humanplay.db.rows import AskedBy
from humanplay.db.store import Store
from humanplay.db.study_rows import participant_label
from humanplay.release.build import build_release, request_of
from humanplay.report.costs import no_bar
from humanplay.report.making import make_study_report
from humanplay.report.model import Report
from humanplay.report.page import render
from humanplay.study.closing import close_study, note_closed
from humanplay.study.data import load
from humanplay.study.files import now_ms
from humanplay.study.folder import Folder, Study
from humanplay.study.invitations import Invitations, token_of
from humanplay.study.protocol import default_protocol
from humanplay.study.seeds import seed as seed_of
from humanplay.study.verification import verify_database
from humanplay.task.registration import environment_of
from humanplay.tasks.mars.policies import PolicyCatalogue
from humanplay.web.simulate import Clock, NoisyPolicy, Participant, RefusedError
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.intervals import Floats
from marsexplorer.policies import load as load_policy
from tests.support.declared import DECLARATIONS
from tests.support.servers import hasty_limits, running_server

NAME, RULE, PANEL_ID = "campaign", "frontier-cost", "PROLIFIC_PID"
CONFIG = EnvConfig.of("random", (9, 9))
SLIPS = (0.02, 0.1, 0.2, 0.35)
"""Shares of random moves of the honest people, in turn."""
CHEATS = 2
"""How many cheat where not everybody does."""
SECRETS = 100
"""Drawn by an operator who keeps the best."""


@dataclass(frozen=True)
class Player:
    """A participant.

    slip   share of their moves that are random
    how    "plays" on; once an episode has taken `late` moves, "leaves" or "spoils" it or "closes"
           the tab, or "hurries" on, faster than hands can; "quits" each before a move; "delegates"
           the last terrain to a program; "loses" the first message of the last; "withdraws" at the
           debrief
    link   the number of their invitation or outside id
    """

    seed: int
    slip: float
    link: int
    how: str = "plays"
    late: int = 0


@dataclass(frozen=True)
class PlayedStudy:
    """A study played to its end: database, folder, people's labels, report."""

    database: Path
    folder: Folder
    people: tuple[str, ...]
    report: Report
    name: str = NAME

    @property
    def steps(self) -> tuple[float, float]:
        """Mean steps to 99 % of who finished and of everybody who began; NaN of nobody."""
        first, second, *_ = (estimate.steps for estimate in self.report.groups[0].figures)
        return (first.mean if first else np.nan, second.mean if second else np.nan)

    @property
    def rule_steps(self) -> float:
        """The mean steps of the rule on the ranked terrains."""
        study = self.folder.study(self.name)
        seeds = [study.seed("ranked", at) for at in range(study.protocol.ranked)]
        return float(np.mean([_rules_steps(seed) for seed in seeds]))

    def warning(self, words: str) -> str | None:
        """The caution, or else the page's sentence, that matches a regular expression."""
        cautions = (
            caution for caution in self.report.groups[0].cautions if re.search(words, caution)
        )
        if (first := next(cautions, None)) is not None:
            return first
        text = re.sub(r"<(style|script|svg).*?</\1>", " ", render(self.report), flags=re.DOTALL)
        text = re.sub(r"</(p|li|td|h\d|summary)>", "\n", text)
        text = html.unescape(re.sub(r"<[^>]+>", "", text))
        parts = (part.strip() for part in re.split(r"(?<=[.!?])\s+|\n", text))
        return next((part for part in parts if re.search(words, part)), None)


class _Hurried(Clock):
    """The clock of a program that presses every 10 ms, whatever the server's does."""

    def __init__(self, clock: Clock) -> None:
        super().__init__()
        self._clock, self._last = clock, float("inf")

    def page_ms(self) -> float:
        self._last = min(self._clock.page_ms(), self._last + 5)
        return round(self._last, 1)

    def wait(self, ms: float) -> None:
        pass


class Campaign:
    """Studies of one seed, with and without a cheat; shared ones are played once."""

    def __init__(self, root: Path, seed: int, players: int, ranked: int) -> None:
        self.root, self.seed, self.ranked, self._count = root, seed, ranked, 0
        self.honest_people = tuple(
            Player(1000 * seed + at, SLIPS[at % len(SLIPS)], at) for at in range(players)
        )
        self.honest = cache(self._honest)

    def secret(self, number: int = 0) -> bytes:
        """Return the secret that an operator draws as `number`."""
        return random.Random(f"{self.seed} {number}").randbytes(32)

    def _honest(self, recruitment: str = "invitation") -> PlayedStudy:
        return self.play(self.honest_people, recruitment)

    def late(self) -> int:
        """The moves after which an episode goes badly: the median of the people's means."""
        return int(np.median([row.steps for row in self.honest().report.groups[0].players]))

    def worst(self) -> list[int]:
        """Return the numbers of the two honest people who need the most moves."""
        played = self.honest()
        ranked = [trial for trial in load(played.database, NAME).trials if trial.phase == "ranked"]
        steps = {
            person: sum(
                trial.steps_to_target or 0
                for trial in ranked
                if participant_label(trial.participant) == person
            )
            for person in played.people
        }
        worst = sorted(played.people, key=steps.__getitem__, reverse=True)[:CHEATS]
        return [played.people.index(person) for person in worst]

    def some(self, how: str, numbers: Sequence[int], late: int | None = None) -> list[Player]:
        """Return the honest people, some of whom do otherwise after `late` moves: once an
        episode goes badly.
        """
        late = self.late() if late is None else late
        return [
            replace(player, how=how, late=late) if at in numbers else player
            for at, player in enumerate(self.honest_people)
        ]

    def more(self, how: str = "plays", late: int = 0) -> list[Player]:
        """Return the honest people, and programs beside them that never slip."""
        count = len(self.honest_people)
        added = [Player(10**6 + self.seed + at, 0.0, count + at, how, late) for at in range(CHEATS)]
        return [*self.honest_people, *added]

    def play(
        self,
        people: Sequence[Player],
        recruitment: str = "invitation",
        secret: bytes | None = None,
        name: str = NAME,
        place: Path | None = None,
        erased: Sequence[int] = (),
    ) -> PlayedStudy:
        """Let people take part in a study on a real server, close it, and return it.

        Args:
            place: The folder of its database; a new one by default.
            erased: Numbers of those who are erased before it is closed.
        """
        place = place or self._new_place()
        folder, database = Folder(place / "playground.db-studies"), place / "playground.db"
        rest: dict[str, Any] = {
            "warm_up": 1,
            "ranked": self.ranked,
            "players": len(self.honest_people),
        }
        rest |= {"break_every": self.ranked, "policies": (RULE,), "debrief_policy": RULE}
        rest |= {"recruitment": recruitment, "outside_ids": (PANEL_ID,)}
        rest |= {"declarations": DECLARATIONS}
        folder.create(default_protocol(name, CONFIG, **rest))
        study = folder.freeze(name, draw=lambda _: secret or self.secret())
        links = [""] * len(people)
        if recruitment == "invitation":
            issued = Invitations(folder).issue(name, 1 + max(player.link for player in people))
            links = [token_of(study, invitation.id) for invitation in issued]
        settings = {"database": database, "limits": hasty_limits()}
        with running_server(_policies(), **settings) as server:
            ids = tuple(_take_part(server, study, player, links) for player in people)
        joined = tuple(filter(None, ids))
        for number in erased:
            forget(database, joined[number])
        closed = close_study(folder, None, name, now_ms(), True)
        with closing(Store(database)) as store:  # as a server does that finds it closed
            note_closed(store, closed)
        return PlayedStudy(database, folder, joined, self.report(database, folder, name), name)

    def _new_place(self) -> Path:
        self._count += 1
        return self.root / f"{self.seed}-{self._count}"

    def report(self, database: Path, folder: Folder, name: str = NAME) -> Report:
        """Return the report of a study in whose database `verify` finds nothing."""
        findings = verify_database(database).findings
        if findings:
            raise click.ClickException(f"verify finds differences in {database}: {findings}")
        return make_study_report(
            database, folder, name, no_bar, with_policies=False, with_moves=False
        )

    def erased(self, played: PlayedStudy, asked_by: AskedBy | None = None) -> PlayedStudy:
        """A closed study after the worst were erased, with a new release."""
        place = self._new_place()
        shutil.copytree(played.database.parent, place)
        folder, database = Folder(place / "playground.db-studies"), place / played.database.name
        for number in self.worst():
            forget(database, played.people[number], asked_by=asked_by)
        build_release(request_of(NAME, place / "release", database, folder, ("A. Author",)))
        return PlayedStudy(database, folder, played.people, self.report(database, folder))

    def best_of_three(self) -> PlayedStudy:
        """The best of three studies of one design in one database; the first is honest.

        The best by those who finished.
        """
        place, played = self._new_place(), {}
        for number, name in enumerate((NAME, f"{NAME}-2", f"{NAME}-3")):
            people = [
                replace(player, seed=player.seed + 100 * number) for player in self.honest_people
            ]
            played[name] = self.play(people, secret=self.secret(number), name=name, place=place)
        best = min(played.values(), key=lambda study: study.steps[0])
        return replace(best, report=self.report(best.database, best.folder, best.name))

    def easiest(self) -> bytes:
        """The one of many secrets on whose terrains the rule needs the fewest moves."""
        digest = self.honest().folder.study(NAME).protocol_hash

        def moves(secret: bytes) -> float:
            seeds = (seed_of(secret, digest, "ranked", at) for at in range(self.ranked))
            return float(np.mean([_rules_steps(seed) for seed in seeds]))

        return min((self.secret(number) for number in range(SECRETS)), key=moves)


@cache
def _policies() -> PolicyCatalogue:
    return PolicyCatalogue()


def _rules_steps(seed: int) -> int:
    episode, policy = Episode.begin(CONFIG, seed=seed), load_policy(RULE, CONFIG.sensor_radius)
    policy.reset(0)
    while not episode.ended:
        episode.step(policy.act(episode.observation()))
    return episode.steps if episode.record().outcome == "explored" else CONFIG.limit


def _take_part(server: Any, study: Study, player: Player, links: Sequence[str]) -> str | None:
    """Let one person take part and return their label; None if they are refused.

    The server lets nobody in a second time.
    """
    policy = NoisyPolicy(environment_of("mars"), RULE, player.slip, CONFIG)
    person = Participant(server.page(), study.name, policy, server.clock, player.seed)
    join = {"invitation": {"invitation": links[player.link]}, "open": {}}
    panel = {"outside_ids": {PANEL_ID: f"panel-{player.link}"}}
    try:
        person.call("join", join.get(study.protocol.recruitment, panel))
        person.call("consent", {"version": "1", "agree": True})
    except RefusedError:
        return None
    ident = str(person.where["participant"])
    person.call("advance", {"from": "instructions"})
    person.call("next")
    _give_up(person)
    person.call("advance", {"from": "tutorial"})
    person.answer_questions()
    at = 0
    while person.me()["stage"] in ("warm_up", "ranked"):
        person.call("next")
        if person.where["phase"] == "warm_up":
            _give_up(person)
        else:
            at += 1
            if not _play(person, player, at, at == study.protocol.ranked):
                break
    if player.how == "withdraws":
        person.call("withdraw", {"erase": True})
    return ident


def _give_up(person: Participant) -> None:
    frame = person.me()["about"]["frame"]
    person.call("give-up", {"episode": frame["episode"], "step": frame["step"]})


def _play(person: Participant, player: Player, at: int, is_last: bool) -> bool:
    """Play a ranked episode, the first being 1; False for a person who stays away."""
    is_delegated = is_last and player.how == "delegates"
    slip = 0.0 if is_delegated else player.slip
    policy = NoisyPolicy(environment_of("mars"), RULE, slip, CONFIG, 100 * player.seed + at)
    policy.reset()
    with person.socket() as socket:
        hurried = _Hurried(socket.clock)
        frame = socket.receive("frame")
        while frame["outcome"] is None:
            if player.how == "hurries" and frame["step"] >= player.late:
                socket.clock = hurried
            is_late = 0 < player.late <= frame["step"]
            if is_late and player.how == "closes":
                return False
            if player.how == "quits" or (is_late and player.how == "leaves"):
                break
            action = policy.choose(frame)
            if frame["step"] == 0 and is_last and player.how == "loses":
                at_ms = socket.clock.page_ms()
                sent = {"kind": "act", "episode": frame["episode"], "step": 0, "action": action}
                times = {"key_down_ms": at_ms, "client_ms": at_ms}
                socket.send({**sent, "input": "key", **times})
            else:
                is_spoilt = is_delegated or (is_late and player.how == "spoils")
                socket.act(frame, action, None if is_spoilt else "key")
            frame = socket.frame_after(frame["step"])
    if frame["outcome"] is None:
        _give_up(person)
    return True


@dataclass(frozen=True)
class Attack:
    """A row: what is tried, and the studies (without, with) that are compared.

    words  of what in the report may warn of it, a regular expression; None where nothing does
    """

    tried: str
    studies: Callable[[Campaign], tuple[PlayedStudy, PlayedStudy]]
    words: str | None = None


MISSING = r"of \d+ people who began a ranked episode (is|are) not in the per-protocol estimate"
NEITHER = r"of \d+ people who agreed (is|are) in neither estimate"
ERASED = r"people who had begun a ranked episode were erased"


def _worst(campaign: Campaign, how: str) -> tuple[PlayedStudy, PlayedStudy]:
    """Return a study without and with the worst two doing otherwise."""
    return campaign.honest(), campaign.play(campaign.some(how, campaign.worst()))


def _everybody(campaign: Campaign, how: str) -> PlayedStudy:
    return campaign.play(campaign.some(how, range(len(campaign.honest_people))))


def _again(campaign: Campaign, recruitment: str) -> tuple[PlayedStudy, PlayedStudy]:
    """A study without and with two people who come again from a second browser."""
    first = campaign.honest_people[:CHEATS]
    again = [replace(player, seed=player.seed + 500, slip=0.0) for player in first]
    played = campaign.play([*campaign.honest_people, *again], recruitment)
    return campaign.honest(recruitment), played


ATTACKS = {
    "leaving": Attack(
        "everybody gives up what goes badly, against playing on",
        lambda it: (it.honest(), _everybody(it, "leaves")),
        MISSING,
    ),
    "spoiling": Attack(
        "everybody spoils what goes badly, against leaving it",
        lambda it: (_everybody(it, "leaves"), _everybody(it, "spoils")),
    ),
    "closing-tab": Attack(
        "the two worst close the tab on what goes badly and never come back",
        lambda it: _worst(it, "closes"),
        MISSING,
    ),
    "giving-up": Attack(
        "the two worst give every ranked terrain up at once",
        lambda it: _worst(it, "quits"),
        MISSING,
    ),
    "last-by-program": Attack(
        "the two worst let a program play their last terrain",
        lambda it: _worst(it, "delegates"),
        MISSING,
    ),
    "lost-message": Attack(
        "of the two worst the first key message of an episode is lost",
        lambda it: _worst(it, "loses"),
        MISSING,
    ),
    "erasing-open": Attack(
        "the two worst finishers are erased while the study is open",
        lambda it: (it.honest(), it.play(it.honest_people, erased=it.worst())),
        ERASED,
    ),
    "erasing": Attack(
        "the two worst finishers are erased after closing, then a new release",
        lambda it: (it.honest(), it.erased(it.honest())),
        ERASED,
    ),
    "withdrawing": Attack(
        "the two worst withdraw at the debrief, and are erased after closing",
        lambda it: (
            it.honest(),
            it.erased(it.play(it.some("withdraws", it.worst())), "participant"),
        ),
        ERASED,
    ),
    "best-of-three": Attack(
        "three studies of one design are played, and the best is reported",
        lambda it: (it.honest(), it.best_of_three()),
        r"2 other studies of this configuration were frozen",
    ),
    "panel-ids": Attack(
        "programs at a person's pace come to a panel study by two invented ids",
        lambda it: (it.honest("panel"), it.play(it.more(), "panel")),
        r"whose ids anybody may make up",
    ),
    "forged-pace": Attack(
        "two programs with an invitation press every 10 ms",
        lambda it: (it.honest(), it.play(it.more("hurries"))),
        NEITHER,
    ),
    "slow-start": Attack(
        f"they do so after {FIRST_MOVES + 1} moves at a person's pace",
        lambda it: (it.honest(), it.play(it.more("hurries", FIRST_MOVES + 1))),
        MISSING,
    ),
    "hurrying": Attack(
        "the two worst let a program press every 10 ms, from the first move of each terrain",
        lambda it: (it.honest(), it.play(it.some("hurries", it.worst(), late=0))),
        NEITHER,
    ),
    "persons-pace": Attack(
        "two programs with an invitation press at a person's pace",
        lambda it: (it.honest(), it.play(it.more())),
        r"at a person's pace is attested",
    ),
    "ground-secrets": Attack(
        f"the operator draws {SECRETS} secrets and keeps the one with the easiest terrains",
        lambda it: (it.honest(), it.play(it.honest_people, secret=it.easiest())),
    ),
    "rejoin-link": Attack(
        "two come again by the same invitation in a second browser",
        lambda it: _again(it, "invitation"),
    ),
    "rejoin-browser": Attack(
        "two come again to an open study in a second browser, and play better",
        lambda it: _again(it, "open"),
        r"by a link that anybody could open",
    ),
}


@dataclass(frozen=True)
class Row:
    """What an attack gained, in steps to 99 %, and what warns of it.

    gains    float64[studies, 3]: per protocol, everybody, and per protocol in the difference from
             the rule on the same terrains; positive: better for the cheat
    warning  in the last report with the cheat, twin: in that without it; None for none
    """

    name: str
    tried: str
    gains: Floats
    warning: str | None
    twin: str | None

    @property
    def gain(self) -> Floats:
        """The mean gains, in the order of `gains`."""
        means: Floats = self.gains.mean(axis=0)
        return means

    @property
    def error(self) -> Floats:
        """The standard errors of the gains over studies; 0 for a single one."""
        several = len(self.gains) > 1
        spread = self.gains.std(axis=0, ddof=1) if several else np.zeros(3)
        errors: Floats = spread / np.sqrt(len(self.gains))
        return errors

    @property
    def cells(self) -> list[str]:
        """The gains as they are printed; a dash where nobody is in an estimate."""
        both = zip(self.gain, self.error, strict=True)
        return ["–" if np.isnan(gain) else f"{gain:+.1f} ± {error:.1f}" for gain, error in both]


def measure(
    names: Sequence[str],
    root: Path,
    seeds: Sequence[int],
    players: int,
    ranked: int,
    advance: Callable[[int, int], None] = lambda *_: None,
) -> list[Row]:
    """Return a row for each attack, over paired studies of these seeds."""
    gains: dict[str, list[Floats]] = {name: [] for name in names}
    warnings: dict[str, tuple[str | None, str | None]] = {}
    for at, seed in enumerate(seeds):
        campaign = Campaign(root, seed, players, ranked)
        for number, name in enumerate(names, 1):
            without, having = ATTACKS[name].studies(campaign)
            both = np.subtract(without.steps, having.steps)
            easier = without.rule_steps - having.rule_steps
            gains[name].append(np.append(both, both[0] - easier))
            words = ATTACKS[name].words
            if words is not None:
                warnings[name] = having.warning(words), without.warning(words)
            advance(at * len(names) + number, len(seeds) * len(names))
    return [
        Row(name, ATTACKS[name].tried, np.array(studies), *warnings.get(name, (None, None)))
        for name, studies in gains.items()
    ]


@click.command(context_settings={"show_default": True})
@click.argument("rows", nargs=-1, type=click.Choice(list(ATTACKS)), metavar="[ROW]...")
@click.option("--studies", type=click.IntRange(min=1), default=4, help="Paired studies of a row.")
@click.option("--players", type=click.IntRange(min=3), default=5, help="Honest people of a study.")
@click.option("--ranked", type=click.IntRange(min=2), default=4, help="Ranked terrains of 9x9.")
@click.option("--seed", type=click.IntRange(min=0), default=0, help="Of the first study.")
def main(rows: tuple[str, ...], studies: int, players: int, ranked: int, seed: int) -> None:
    """Play studies with and without a cheat, and print what each cheat gains.

    They run on a real server, and gains are in steps to 99 %.

    ROW is one of those of the printed table; none: all.

    A gain is the mean without the cheat minus that with it, of who finished (per protocol) and of
    everybody who began, the mean over paired studies of the same seeds ± its standard error:
    positive is better for the cheat. A difference is claimed where both estimates show it. The
    third column is the gain in the difference from the rule on the same terrains, of who finished.
    Beside them stands what in the built report warns of it.

    \b
      python -m research.methods.study_campaign                     # all, some minutes
      python -m research.methods.study_campaign spoiling erasing --studies 1
    """
    with TemporaryDirectory() as place, progress_bar("playing studies") as advance:
        seeds = range(seed, seed + studies)
        measured = measure(rows or list(ATTACKS), Path(place), seeds, players, ranked, advance)
    click.echo(
        "| row | what is tried | per protocol | everybody | against the rule | what the report "
        "says |"
    )
    click.echo("| --- | --- | ---: | ---: | ---: | --- |")
    for row in measured:
        click.echo(f"| {' | '.join([row.name, row.tried, *row.cells, row.warning or ''])} |")


if __name__ == "__main__":
    main(prog_name="python -m research.methods.study_campaign")
