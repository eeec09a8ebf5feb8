"""The campaign of cheats, small: what shall gain nothing gains nothing, and of what gains the report warns."""

import hashlib

import numpy as np
import pytest

from app.series.seeds import key_of
from app.series.seeds import seed as seed_of
from research.methods.study_campaign import (
    ATTACKS,
    NAME,
    SECRETS,
    Campaign,
    _rules_steps,
    measure,
)

NEVER = ("leaving", "forged-pace")
"""What makes the figure worse for who tries it."""


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    found = measure(list(ATTACKS), tmp_path_factory.mktemp("campaign"), [0], 4, 2)
    return {row.name: row for row in found}


def test_what_shall_gain_nothing_gains_nothing(rows):
    assert rows["spoiling"].gain == rows["rejoin-link"].gain == 0
    assert all(rows[name].gain < 0 for name in NEVER)


def test_the_report_warns_of_whatever_may_gain(rows):
    warned = {name: row for name, row in rows.items() if ATTACKS[name].words}
    assert {*rows} - {*warned} == {"spoiling", "rejoin-link", "ground-beacon", *NEVER}
    for name, row in warned.items():
        assert row.sentence, name
        assert row.gain > 0, "what is said to gain and does not shall lose its sentence here"


def test_a_beacon_takes_what_grinding_gains(tmp_path):
    campaign = Campaign(tmp_path, 0, 3, 2)
    digest = campaign.honest().folder.study(NAME).protocol_hash

    def moves(key):
        return np.mean([_rules_steps(seed_of(key, digest, "ranked", at)) for at in range(2)])

    usual = [moves(campaign.secret(number)) for number in range(SECRETS)]
    best = campaign.easiest()
    signatures = [hashlib.sha384(bytes([at])).hexdigest() for at in range(SECRETS)]
    mixed = [moves(key_of(best, signature)) for signature in signatures]
    error = np.hypot(np.std(usual), np.std(mixed)) / SECRETS**0.5
    assert moves(best) == min(usual) < np.mean(usual) - 5 * error
    assert np.mean(mixed) == pytest.approx(np.mean(usual), abs=3 * error)
