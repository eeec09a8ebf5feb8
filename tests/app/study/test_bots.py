"""Bots in a study: the report counts them and leaves them out of both estimates."""

import json
from contextlib import contextmanager
from functools import partial

import pytest

from humanplay.study.folder import Folder
from humanplay.study.invitations import Invitations, token_of
from tests.support.command import command, run
from tests.support.study import Person, freeze

HONEST = 4


class HastyHand:
    """The clock of a program that plays `slow` moves at a person's pace, then hurries.

    It then presses every 10 ms.
    """

    def __init__(self, clock, slow):
        self.clock, self.slow, self.last_ms = clock, slow, 0.0
        self.presses = 0

    def page_ms(self):
        """The time of the next press; each is asked for twice, going down and coming up."""
        self.presses += 1
        now_ms = self.clock.page_ms()
        is_fast = self.last_ms and self.presses > 2 * self.slow
        self.last_ms = min(now_ms, self.last_ms + 5) if is_fast else now_ms
        return round(self.last_ms, 1)

    def wait(self, ms):
        if self.presses < 2 * self.slow:
            self.clock.wait(ms)


class Bot(Person):
    """A participant whose ranked episodes a program plays."""

    def __init__(self, server, slow, **join):
        super().__init__(server, **join)
        self.slow = slow

    @contextmanager
    def socket(self):
        with super().socket() as socket:
            if self.where["phase"] == "ranked":
                socket.clock = HastyHand(self.server.clock, self.slow)
            yield socket


@pytest.fixture
def report(server, tmp_path, capsys):
    """`report(*slow)` plays a study of honest people, and of a bot for each of `slow`.

    It returns the report's group of people.
    """

    def made(*slow):
        folder = Folder(tmp_path / "playground.db-studies")
        study = freeze(
            folder.root, size=(12, 12), ranked=2, players=HONEST, recruitment="invitation"
        )
        issued = Invitations(folder).issue(study.name, HONEST + len(slow))
        people = [Person] * HONEST + [partial(Bot, slow=moves) for moves in slow]
        for who, invitation in zip(people, issued, strict=True):
            person = who(server, invitation=token_of(study, invitation.id))
            person.to_warm_up()
            person.play_on()
        database = "--database", tmp_path / "playground.db"
        assert run("study", "close", "small", "--now", "--yes", *database) == 0
        options = "--no-policies", "--no-moves", "--json", tmp_path / "report.json"
        code, _, err = command(capsys, "report", "--study", "small", *options, *database)
        assert (code, err) == (0, "")
        (group,) = json.loads((tmp_path / "report.json").read_text())["groups"]
        return group

    return made


def test_programs_that_press_every_ten_milliseconds_are_in_neither_estimate(report):
    group = report(0, 0)
    finished, everybody = group["figures"][:2]
    assert (finished["players"], everybody["players"]) == (HONEST, HONEST)
    assert everybody["steps"]["mean"] == finished["steps"]["mean"]
    assert group["flow"]["people"] == {"finished": HONEST, "bot": 2}
    (caution,) = (line for line in group["cautions"] if "in neither estimate" in line)
    assert caution.startswith("2 of 6 people who agreed are in neither estimate")


def test_a_person_who_lets_a_program_go_on_stays_in_the_second_estimate(report):
    group = report(6)
    assert group["flow"]["people"] == {"finished": HONEST, "partly_bot": 1}
    assert group["figures"][1]["players"] == HONEST + 1
