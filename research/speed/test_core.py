"""How fast the rules are, and how often a drawn terrain counts.

Absolute figures are printed; only ratios of one run gate.
"""

import pytest

from marsexplorer.config import LEVELS, EnvConfig
from marsexplorer.terrain import attempts
from research.speed import core
from research.speed.peers import PEERS, measure
from research.speed.start import first_steps

pytestmark = pytest.mark.bench


def test_the_table_of_the_core():
    print("\n")
    for measured in core.measures():
        figure = measured()
        print(
            f"{figure.name} {figure.at}: {figure.value:,.2f} {figure.unit} {figure.verdict} "
            f"{figure.note}"
        )
        assert figure.value > 0


def test_a_step_at_84_costs_at_most_half_more_than_at_21():
    rates = {
        side: core.steps_per_cpu_second(EnvConfig.of("random", side), 1024) for side in (21, 84)
    }
    print(f"\n84x84 over 21x21: {rates[21] / rates[84]:.2f}")
    assert rates[21] <= 1.5 * rates[84]


@pytest.mark.parametrize(("blind", "least"), [(False, 0.65), (True, 0.75)])
def test_make_vec_makes_most_of_the_steps_of_the_bare_stack(blind, least):
    rate, share = core.vector_share(blind=blind, rounds=450 if not blind else 150, repeats=7)
    print(f"\n{rate:,.0f} steps per CPU second, {share:.2f} of the bare stack's")
    assert share > least


def test_first_steps_are_a_fifth_as_dear_once_the_rules_are_compiled():
    figures = first_steps()
    for figure in figures:
        print(f"\n{figure.name}: {figure.value:.2f} CPU s, {figure.note}, {figure.verdict}", end="")
    for cold, warm in zip(figures[::2], figures[1::2], strict=True):
        assert warm.value < cold.value / 5


def test_memory_of_a_world():
    assert core.bytes_of_a_world(EnvConfig()) < 1500


def test_no_peer_in_python_is_as_fast():
    rates = {peer.name: measure(peer, 1.0) for peer in PEERS}
    for name, figure in rates.items():
        print(f"\n{name}: {figure.value or figure.note}", end="")
    ours = rates["MarsExplorer, gymnasium.make_vec, 1,024"].value
    for name in ("FrozenLake, gymnasium.make", "MiniGrid FourRooms", "Crafter"):
        assert rates[name].value is None or rates[name].value < ours


def test_acceptance_of_draws():
    print("\n\n| level | 21x21 | 42x42 | 84x84 |\n|---|---|---|---|")
    for name in (name for name in LEVELS if not name.endswith("-2")):
        rates = []
        for size, seeds in ((21, 1000), (42, 400), (84, 150)):
            config = EnvConfig.of(name, size)
            rates.append(seeds / sum(attempts(config, seed) for seed in range(seeds)))
        print(f"| {name} | " + " | ".join(f"{100 * rate:.0f} %" for rate in rates) + " |")
