"""What holds of the algorithms where tianshou is not installed, and of variants and interrupts everywhere."""

import os
import signal
from importlib.util import find_spec

import pytest

from marsexplorer.config import EnvConfig
from marsexplorer.paper.algorithms import begin, check_variant
from marsexplorer.paper.trainers.variants import Variants
from marsexplorer.training.interrupts import postponed_interrupt

CHANGES = {"reward": {"a": 1}, "mask": {"b": 2}, "rest": {"c": 3}}
VARIANTS = Variants("SARSA", CHANGES, works=("reward", "mask"), tuned=("reward", "mask", "rest"))


@pytest.mark.parametrize("algorithm", ["a2c", "rainbow", "sac"])
def test_without_tianshou_a_sentence_says_what_to_run(algorithm):
    if find_spec("tianshou"):
        pytest.skip("tianshou is installed here")
    with pytest.raises(ImportError, match="not installed here; run `make paper`"):
        begin(algorithm, "paper", EnvConfig.of("random", 7), 1, 1000)


@pytest.mark.parametrize(
    ("variant", "settings"),
    [
        ("paper", {}),
        ("works", {"a": 1, "b": 2}),
        ("works-no-mask", {"a": 1}),
        ("tuned", {"a": 1, "b": 2, "c": 3}),
        ("tuned-no-mask", {"a": 1, "c": 3}),
        ("paper+rest", {"c": 3}),
        ("paper+mask+rest", {"b": 2, "c": 3}),
    ],
)
def test_a_variant_is_the_paper_with_its_changes(variant, settings):
    assert VARIANTS.settings_for(variant) == settings


@pytest.mark.parametrize(
    "variant",
    [
        "",
        "work",
        "works-no",
        "works-no-",
        "works-no-rest",
        "paper-no-mask",
        "paper+",
        "paper+none",
        "paper-reward",
    ],
)
def test_an_unknown_variant_is_an_error_that_names_the_others(variant):
    with pytest.raises(
        ValueError,
        match=r"SARSA has no variant .*works-no-mask, tuned, .*tuned-no-rest, paper\+reward",
    ):
        VARIANTS.settings_for(variant)


@pytest.mark.parametrize("algorithm", ["a2c", "rainbow", "sac"])
def test_variants_are_checked_without_tianshou(algorithm):
    check_variant(algorithm, "works-no-features")
    with pytest.raises(ValueError, match="has no variant 'wroks'"):
        check_variant(algorithm, "wroks")


def test_ctrl_c_waits_for_the_end_of_the_block():
    done = []

    def block():
        with postponed_interrupt():
            os.kill(os.getpid(), signal.SIGINT)
            done.append("the rest of the block")

    with pytest.raises(KeyboardInterrupt):
        block()
    assert done == ["the rest of the block"]
