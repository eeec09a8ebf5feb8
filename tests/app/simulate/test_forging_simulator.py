"""The simulator as a forger: it joins as a person, sends each press before its move, and nobody but its pace gives it away.

`pytest -m long -s tests/app/simulate/test_forging_simulator.py` prints how many episodes of it are attested.
"""

import asyncio
import time
from collections import Counter

import pytest

from app.simulate.input_device import InputDevice, PageClock
from app.simulate.outcome_log import OutcomeLog
from app.simulate.participant import PlaySettings, SimulatedParticipant
from app.simulate.persona import draw_persona
from app.simulate.population import SIMULATED_POPULATIONS
from app.simulate.state_file import SavedPlayer
from app.statistics.exclusion_sets import people_of
from app.study.data import load
from app.study.folder import Folder
from app.study.invitations import Invitations, token_of
from tests.support.study import freeze

READING_MS = 1_500.0
"""Waits from here on are those of reading and resting, between episodes: nothing checks them."""


class HonestClock(PageClock):
    """A page's clock that never skips: what it says of a press is when it was."""

    def now_ms(self):
        return round((time.perf_counter() - self._loaded) * 1000, 1)

    async def wait(self, ms):
        if ms < READING_MS:
            await asyncio.sleep(ms / 1000 / self.speed)


class SkippingClock(PageClock):
    """The simulator's own clock: waits are short, and are told as if they had been long."""

    async def wait(self, ms):
        await super().wait(ms if ms < READING_MS else 0.0)


class Forger(SimulatedParticipant):
    """A synthetic player that joins as a person, by an invitation, and sends each press before its move."""

    def __init__(self, number, settings, clock, invitation, log):
        self.clock, self.invitation = clock, invitation
        persona = draw_persona(
            number, "noisy-frontier", next(iter(SIMULATED_POPULATIONS.values())), 11
        )
        super().__init__(persona, settings, SavedPlayer(), log, [])

    def _load_page(self):
        super()._load_page()
        self._clock = self.clock(self.settings.speed)
        self._device = Device(
            self.persona, self._clock, self.persona.rng(8, self._loads), self._log
        )
        page, invitation = self._page, self.invitation

        async def join(outside_ids, script):
            found = await page.call("join", {"invitation": invitation})
            page.cookie = page._http.cookies.get("mars_player") or page.cookie
            page._http.cookies.clear()
            page._http.headers["Cookie"] = f"mars_player={page.cookie}"
            return found

        page.join = join

    async def _move(self, style):
        board, device = self._board, self._device
        step, action = board.frame["step"], board.decide(style)
        await device.wait_to_decide(action)
        press = device.press(action, step)
        await self._send_events(board.frame["episode"])
        round_trip = await board.act(action, press)
        await device.release(action, board.frame["step"], round_trip)


class Device(InputDevice):
    """The simulator's keyboard; a touch names its arrow, as the page's does."""

    def _code(self, action):
        return super()._code(action) or action


async def play(server, tokens, clock, speed):
    """Let as many forgers as there are invitations play a study side by side; one by one when they are to be fast."""
    settings, log = PlaySettings(server.url, "small", 10, speed, 60.0), OutcomeLog()
    forgers = [Forger(number, settings, clock, token, log) for number, token in enumerate(tokens)]
    if speed == 1:
        await asyncio.gather(*(forger.play() for forger in forgers))
    for forger in forgers if speed != 1 else ():
        await forger.play()


def forged_levels(server, root, clock, speed, players=10):
    """Return (ranked episodes by level, ranked episodes that enter a human figure) of forgers with valid invitations."""
    freeze(
        root,
        size=(9, 12),
        warm_up=1,
        ranked=2,
        players=players,
        recruitment="invitation",
        hides_interim=False,
    )
    study = Folder(root).study("small")
    issued = Invitations(Folder(root)).issue("small", players)
    asyncio.run(play(server, [token_of(study, each.id) for each in issued], clock, speed))
    data = load(server.services.store.path, "small")
    assert len(data.people) == players
    levels = Counter(trial.attestation for trial in data.trials if trial.phase == "ranked")
    return levels, sum(map(len, people_of(data).ranked.values()))


@pytest.mark.long
@pytest.mark.parametrize("clock", [HonestClock, SkippingClock])
def test_at_a_hundred_times_a_persons_speed_no_episode_counts(server, tmp_path, clock):
    levels, counted = forged_levels(server, tmp_path / "studies", clock, 100.0)
    print(
        f"\n{clock.__name__}, a hundred times a person's speed: {dict(levels)}, counted {counted}"
    )
    assert (levels, counted) == (Counter(unattested=20), 0)


@pytest.mark.long
def test_at_a_persons_speed_nothing_gives_it_away(server, tmp_path):
    """Measure what docs/study.md states; should a check ever find it, the document is to be changed."""
    levels, counted = forged_levels(server, tmp_path / "studies", HonestClock, 1.0)
    print(
        f"\na person's speed, honest stamps: {dict(levels)}, counted {counted} of 20 ranked episodes of 10 forgers"
    )
    assert counted == levels["attested"] >= 18
