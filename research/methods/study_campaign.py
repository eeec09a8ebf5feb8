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

from app.cli.console import progress as progress_bar
from app.db.erasure import forget
from app.db.store import Store
from app.db.study_rows import participant_label
from app.release.build import build_release, request_of
from app.report.costs import no_bar
from app.report.making import make_study_report
from app.report.model import Report
from app.report.page import render
from app.series.closing import close_study, note_closed
from app.series.data import load
from app.series.files import now_ms
from app.series.folder import Folder
from app.series.invitations import Invitations, token_of
from app.series.protocol import default_protocol
from app.series.seeds import seed as seed_of
from app.series.verification import verify_database
from app.tasks.mars.players import NoisyPolicy
from app.tasks.mars.policies import PolicyCatalogue
from app.web.simulate import Clock, Participant, RefusedError
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies import load as load_policy
from tests.support.beacons import OwnBeacon
from tests.support.declared import DECLARATIONS
from tests.support.servers import hasty_limits, running_server

NAME, RULE, PANEL_ID = "campaign", "frontier-cost", "PROLIFIC_PID"
CONFIG = EnvConfig.of("random", (9, 9))
SLIPS = (0.02, 0.1, 0.2, 0.35)
"""Shares of random moves of the honest people, in turn."""
CHEATS = 2
"""How many cheat where not everybody does."""
ROUND = 10**9
"""Of the beacon, in centuries, so that every run names the same."""
SECRETS = 100
"""Drawn by an operator who keeps the best."""


@dataclass(frozen=True)
class Player:
    """A participant.

    slip   share of their moves that are random
    how    what they do with an episode once it has taken `late` moves: "plays" on, "leaves", "spoils" it, or "closes" the tab;
           "hurries" presses faster than hands can
    link   the number of their invitation or outside id
    """

    seed: int
    slip: float
    link: int
    how: str = "plays"
    late: int = 0


@dataclass(frozen=True)
class Played:
    """A study played to its end: its database, its folder, the labels of its people, and the report."""

    database: Path
    folder: Folder
    people: tuple[str, ...]
    report: Report

    @property
    def steps(self) -> float:
        """The mean steps to 99 % in the primary figure."""
        found = self.report.groups[0].figure.steps
        assert found is not None
        return found.mean

    def sentence(self, words: str) -> str | None:
        """Return the first sentence of the report's page that has these words (a regular expression), None for none."""
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
    """Studies of one seed, with and without a cheat; what several rows need is played once."""

    def __init__(self, root: Path, seed: int, players: int, ranked: int) -> None:
        self.root, self.seed, self.ranked, self._count = root, seed, ranked, 0
        self.honest_people = tuple(
            Player(1000 * seed + at, SLIPS[at % len(SLIPS)], at) for at in range(players)
        )
        self.honest = cache(self._honest)

    def secret(self, number: int = 0) -> bytes:
        """Return the secret that an operator draws as `number`."""
        return random.Random(f"{self.seed} {number}").randbytes(32)

    def _honest(self, recruitment: str = "invitation") -> Played:
        return self.play(self.honest_people, recruitment)

    def late(self) -> int:
        """Return the moves after which an episode is going badly: the median of the honest people's means."""
        return int(np.median([row.steps for row in self.honest().report.groups[0].players]))

    def worst(self) -> list[int]:
        """Return the numbers of the two honest people who need the most moves."""
        played = self.honest()
        ranked = [each for each in load(played.database, NAME).trials if each.phase == "ranked"]
        steps = {
            person: sum(
                each.steps_to_target or 0
                for each in ranked
                if participant_label(each.participant) == person
            )
            for person in played.people
        }
        worst = sorted(played.people, key=steps.__getitem__, reverse=True)[:CHEATS]
        return [played.people.index(person) for person in worst]

    def some(self, how: str, numbers: Sequence[int]) -> list[Player]:
        """Return the honest people, some of whom do otherwise once an episode goes badly."""
        late = self.late()
        return [
            replace(each, how=how, late=late) if at in numbers else each
            for at, each in enumerate(self.honest_people)
        ]

    def more(self, how: str = "plays") -> list[Player]:
        """Return the honest people, and programs beside them that never slip."""
        count = len(self.honest_people)
        added = [Player(10**6 + self.seed + at, 0.0, count + at, how) for at in range(CHEATS)]
        return [*self.honest_people, *added]

    def play(
        self,
        people: Sequence[Player],
        recruitment: str = "invitation",
        secret: bytes | None = None,
        beacon: OwnBeacon | None = None,
    ) -> Played:
        """Let people take part in a study on a real server, close it, and return it with its report."""
        self._count += 1
        place = self.root / f"{self.seed}-{self._count}"
        folder, database = Folder(place / "playground.db-studies"), place / "playground.db"
        rest: dict[str, Any] = {
            "warm_up": 1,
            "ranked": self.ranked,
            "players": len(self.honest_people),
        }
        protocol = default_protocol(
            NAME, CONFIG, **rest, recruitment=recruitment, break_every=self.ranked, policies=(RULE,), debrief_policy=RULE,
            declarations=DECLARATIONS,
        )  # fmt: skip
        folder.create(protocol)
        named = replace(beacon.after(now_ms()), round=ROUND) if beacon else None
        study = folder.freeze(NAME, beacon=named, draw=lambda _: secret or self.secret())
        if beacon and named:
            study = folder.open(NAME, beacon.sign(named))
        links = [""] * len(people)
        if recruitment == "invitation":
            issued = Invitations(folder).issue(NAME, 1 + max(each.link for each in people))
            links = [token_of(study, each.id) for each in issued]
        settings = {"database": database, "limits": hasty_limits()}
        with running_server(_policies(), **settings) as server:
            ids = tuple(_take_part(server, each, links, recruitment) for each in people)
        closed = close_study(folder, None, NAME, now_ms(), True)
        with closing(Store(database)) as store:  # as a server does that finds it closed
            note_closed(store, closed)
        return Played(database, folder, tuple(filter(None, ids)), self.report(database, folder))

    def report(self, database: Path, folder: Folder) -> Report:
        """Return the report of a study in whose database `verify` finds nothing."""
        found = verify_database(database).findings
        if found:
            raise click.ClickException(f"verify finds differences in {database}: {found}")
        return make_study_report(
            database, folder, NAME, no_bar, with_policies=False, with_moves=False
        )

    def erased(self) -> Played:
        """Return the honest study after the worst have erased themselves, and a new release was made of it."""
        honest, place = self.honest(), self.root / f"{self.seed}-erased"
        shutil.copytree(honest.database.parent, place)
        folder, database = Folder(place / "playground.db-studies"), place / honest.database.name
        for number in self.worst():
            forget(database, honest.people[number])
        build_release(request_of(NAME, place / "release", database, folder, ("A. Author",)))
        return Played(database, folder, honest.people, self.report(database, folder))

    def easiest(self) -> bytes:
        """Return the one of many secrets on whose terrains the rule needs the fewest moves, were there no beacon."""
        digest = self.honest().folder.study(NAME).protocol_hash

        def moves(secret: bytes) -> float:
            seeds = (seed_of(secret, digest, "ranked", at) for at in range(self.ranked))
            return float(np.mean([_rules_steps(each) for each in seeds]))

        return min((self.secret(number) for number in range(SECRETS)), key=moves)

    def beacon(self) -> OwnBeacon:
        """Return a beacon whose rounds are signed by a key of this seed."""
        return OwnBeacon(random.Random(f"{self.seed} beacon").randrange)


@cache
def _policies() -> PolicyCatalogue:
    return PolicyCatalogue()


def _rules_steps(seed: int) -> int:
    episode, policy = Episode.begin(CONFIG, seed=seed), load_policy(RULE, CONFIG.sensor_radius)
    policy.reset(0)
    while not episode.ended:
        episode.step(policy.act(episode.observation()))
    return episode.steps if episode.record().outcome == "explored" else CONFIG.limit


def _take_part(server: Any, player: Player, links: Sequence[str], recruitment: str) -> str | None:
    """Let one person take part, and return their label; None where the server lets them in no second time."""
    clock = _Hurried(server.clock) if player.how == "hurries" else server.clock
    policy = NoisyPolicy(RULE, player.slip, CONFIG.sensor_radius)
    person = Participant(server.page(), NAME, policy, clock, player.seed)
    join = {"invitation": {"invitation": links[player.link]}, "open": {}}
    panel = {"outside_ids": {PANEL_ID: f"panel-{player.link}"}}
    try:
        person.call("join", join.get(recruitment, panel))
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
            if not _play(person, player, at):
                break
            at += 1
    return ident


def _give_up(person: Participant) -> None:
    frame = person.me()["about"]["frame"]
    person.call("give-up", {"episode": frame["episode"], "step": frame["step"]})


def _play(person: Participant, player: Player, at: int) -> bool:
    """Play a ranked episode; return False for whoever does not come back."""
    policy = NoisyPolicy(RULE, player.slip, CONFIG.sensor_radius, 100 * player.seed + at)
    policy.reset()
    with person.socket() as socket:
        frame = socket.receive("frame")
        while frame["outcome"] is None:
            is_late = 0 < player.late <= frame["step"]
            if is_late and player.how == "closes":
                return False
            if is_late and player.how == "leaves":
                break
            spoils = is_late and player.how == "spoils"
            socket.act(frame, policy.choose(frame), None if spoils else "key")
            frame = socket.frame_after(frame["step"])
    if frame["outcome"] is None:
        _give_up(person)
    return True


@dataclass(frozen=True)
class Attack:
    """A row: what is tried, and the studies (without, with) that are compared.

    words  of the report's sentence that warns of it, a regular expression; None where it is to gain nothing
    """

    tried: str
    studies: Callable[[Campaign], tuple[Played, Played]]
    words: str | None = None


def _everybody(campaign: Campaign, how: str) -> Played:
    return campaign.play(campaign.some(how, range(len(campaign.honest_people))))


def _again(campaign: Campaign, recruitment: str) -> tuple[Played, Played]:
    """Return a study without and with two people who come again from a second browser, and play without a slip."""
    first = campaign.honest_people[:CHEATS]
    again = [replace(each, seed=each.seed + 500, slip=0.0) for each in first]
    played = campaign.play([*campaign.honest_people, *again], recruitment)
    return campaign.honest(recruitment), played


ATTACKS = {
    "leaving": Attack(
        "everybody gives up what goes badly, against playing on",
        lambda it: (it.honest(), _everybody(it, "leaves")),
    ),
    "spoiling": Attack(
        "everybody spoils what goes badly, against leaving it",
        lambda it: (_everybody(it, "leaves"), _everybody(it, "spoils")),
    ),
    "closing-tab": Attack(
        "the two worst close the tab on what goes badly and never come back",
        lambda it: (it.honest(), it.play(it.some("closes", it.worst()))),
        r"did not end all",
    ),
    "erasing": Attack(
        "the two worst finishers are erased after closing, then a new release",
        lambda it: (it.honest(), it.erased()),
        r"erased after closing, when",
    ),
    "panel-ids": Attack(
        "programs at a person's pace come to a panel study by two invented ids",
        lambda it: (it.honest("panel"), it.play(it.more(), "panel")),
        r"whose ids anybody may make up",
    ),
    "forged-pace": Attack(
        "two programs with an invitation press every 10 ms",
        lambda it: (it.honest(), it.play(it.more("hurries"))),
    ),
    "persons-pace": Attack(
        "two programs with an invitation press at a person's pace",
        lambda it: (it.honest(), it.play(it.more())),
        r"at a person's pace is attested",
    ),
    "ground-secrets": Attack(
        f"the operator draws {SECRETS} secrets and keeps the one with the easiest terrains",
        lambda it: (it.honest(), it.play(it.honest_people, secret=it.easiest())),
        r"No public beacon was named",
    ),
    "ground-beacon": Attack(
        "the same, where a beacon's round was named at freezing: 0 in expectation",
        lambda it: (
            it.play(it.honest_people, beacon=it.beacon()),
            it.play(it.honest_people, secret=it.easiest(), beacon=it.beacon()),
        ),
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
    """What an attack gained in each study, in steps to 99 %, and the sentence of the last report that warns of it."""

    name: str
    tried: str
    gains: tuple[float, ...]
    sentence: str | None

    @property
    def gain(self) -> float:
        """The mean gain; positive: the figure got better for the cheat."""
        return float(np.mean(self.gains))

    @property
    def error(self) -> float:
        """The standard error of the gain over studies; 0 for a single one."""
        spread = np.std(self.gains, ddof=1) if len(self.gains) > 1 else 0.0
        return float(spread / len(self.gains) ** 0.5)


def measure(
    names: Sequence[str],
    root: Path,
    seeds: Sequence[int],
    players: int,
    ranked: int,
    advance: Callable[[int, int], None] = lambda *_: None,
) -> list[Row]:
    """Return a row for each attack, over paired studies of these seeds."""
    gains: dict[str, list[float]] = {name: [] for name in names}
    sentences: dict[str, str | None] = {}
    for at, seed in enumerate(seeds):
        campaign = Campaign(root, seed, players, ranked)
        for number, name in enumerate(names, 1):
            without, having = ATTACKS[name].studies(campaign)
            gains[name].append(without.steps - having.steps)
            words = ATTACKS[name].words
            sentences[name] = None if words is None else having.sentence(words)
            advance(at * len(names) + number, len(seeds) * len(names))
    return [
        Row(name, ATTACKS[name].tried, tuple(found), sentences[name])
        for name, found in gains.items()
    ]


@click.command(context_settings={"show_default": True})
@click.argument("rows", nargs=-1, type=click.Choice(list(ATTACKS)), metavar="[ROW]...")
@click.option("--studies", type=click.IntRange(min=1), default=4, help="Paired studies of a row.")
@click.option("--players", type=click.IntRange(min=3), default=5, help="Honest people of a study.")
@click.option("--ranked", type=click.IntRange(min=2), default=4, help="Ranked terrains of 9x9.")
@click.option("--seed", type=click.IntRange(min=0), default=0, help="Of the first study.")
def main(rows: tuple[str, ...], studies: int, players: int, ranked: int, seed: int) -> None:
    """Play studies with and without a cheat on a real server and print what each cheat gains in steps to 99 %.

    ROW is one of leaving, spoiling, closing-tab, erasing, panel-ids, forged-pace, persons-pace, ground-secrets, ground-beacon,
    rejoin-link and rejoin-browser; none: all.

    A gain is the primary figure without the cheat minus that with it, the mean over paired studies of the same seeds ± its
    standard error: positive is better for the cheat. Beside it stands the sentence of the built report that warns of it.

    \b
      python -m research.methods.study_campaign                     # all, some minutes
      python -m research.methods.study_campaign spoiling erasing --studies 1
    """
    with TemporaryDirectory() as place, progress_bar("playing studies") as advance:
        seeds = range(seed, seed + studies)
        found = measure(rows or list(ATTACKS), Path(place), seeds, players, ranked, advance)
    click.echo("| row | what is tried | gain (steps) | the report's sentence |")
    click.echo("| --- | --- | ---: | --- |")
    for row in found:
        click.echo(
            f"| {row.name} | {row.tried} | {row.gain:+.1f} ± {row.error:.1f} | {row.sentence or ''} |"
        )


if __name__ == "__main__":
    main(prog_name="python -m research.methods.study_campaign")
