"""Synthetic players decide as said, alone and in stacks, and their true level is a number that can be relied on."""

import numpy as np
import pytest

from app.simulate.board import SimulatedBoard
from app.simulate.decisions import DecisionKernel
from app.simulate.persona import PLAYER_KINDS, PlayStyle, assign_kinds, draw_persona
from app.simulate.population import RANDOM_MOVES, SIMULATED_POPULATIONS, draw_players
from app.simulate.true_level import play_episodes, play_studies, true_level
from app.statistics.intervals import printed_interval
from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.intervals import t_interval

CONFIG = EnvConfig.of("random", (9, 13))
SEEDS = tuple(range(40, 46))


def frame_of(episode):
    """A frame as the server sends it, the fields that a board reads."""
    grid = ["".join("?.@#"[code] for code in row) for row in episode.codes]
    rows, cols = episode.codes.shape
    return {
        "kind": "frame", "episode": "e", "step": episode.steps, "rows": rows, "cols": cols, "grid": grid,
        "position": list(episode.position), "heading": episode.heading, "outcome": episode.outcome if episode.ended else None,
    }  # fmt: skip


def board_on(episode):
    """A board that has just learnt where its episode stands, as after a reconnection."""
    board = SimulatedBoard(None, episode.config.sensor_radius, pytest.fail)
    board._apply_frame(frame_of(episode))
    board._restore_path({"positions": episode.path})
    return board


def walk(seed, style, forget_at=()):
    """Play an episode through a board, which forgets everything now and then."""
    episode = Episode.begin(CONFIG, seed=seed)
    board = board_on(episode)
    while not episode.ended:
        if episode.steps in forget_at:
            board = board_on(episode)
        board._apply_frame(frame_of(episode))
        episode.step(("north", "east", "south", "west").index(board.decide(style)))
    return episode


@pytest.mark.parametrize("seed", SEEDS)
def test_without_slips_it_plays_as_frontier_cost(seed):
    episode, policy = (
        Episode.begin(CONFIG, seed=seed),
        policies.load("frontier-cost", CONFIG.sensor_radius),
    )
    policy.reset(seed)
    while not episode.ended:
        episode.step(policy.act(episode.codes))
    assert walk(seed, PlayStyle(0.0, 0.0, 5)).actions == episode.actions


@pytest.mark.parametrize("seed", SEEDS)
def test_a_lost_connection_changes_no_move(seed):
    style = PlayStyle(0.4, 0.001, 2**63 + 11)
    assert walk(seed, style).actions == walk(seed, style, forget_at=(1, 7, 20, 21)).actions


def test_a_stack_plays_as_single_boards_do():
    styles = [PlayStyle(0.1 * i, 0.002 * i, 77 + i) for i in range(len(SEEDS))]
    singles = [walk(seed, style) for seed, style in zip(SEEDS, styles, strict=True)]
    rng = type(
        "Fixed", (), {"integers": lambda *_: np.array([each.stream for each in styles], np.uint64)}
    )()
    slip, crash = (np.array([getattr(each, name) for each in styles]) for name in ("slip", "crash"))
    played = play_episodes(CONFIG, SEEDS, slip, crash, rng)
    assert played.steps.tolist() == [each.steps for each in singles]
    assert played.score.tolist() == [each.score for each in singles]
    assert played.discovered.tolist() == [each.discovered for each in singles]


def test_slips_are_valid_and_crashes_are_not():
    skills = draw_players(RANDOM_MOVES, 50, np.random.default_rng(1))
    slip, crash = skills.draw_episodes(np.arange(50), np.random.default_rng(2))
    rng = np.random.default_rng(3)
    played = play_episodes(CONFIG, range(50), slip, crash, rng)
    assert set(played.outcome) <= {1, 4}  # explored or timed out
    played = play_episodes(CONFIG, range(50), slip, np.ones(50), rng)
    assert set(played.outcome) == {
        3
    }  # from the corner straight off the grid, or into a rock next to it
    assert set(played.steps) == {1}


def test_a_crash_takes_every_invalid_move_as_often():
    kernel, codes = DecisionKernel((5, 5), 6, 3000), np.ones((3000, 5, 5), np.uint8)
    codes[:, 0, 0] = 2
    style = (
        np.zeros(3000),
        np.ones(3000),
        np.random.default_rng(0).integers(0, 2**64, 3000, np.uint64),
    )
    at, moves = np.zeros((3000, 2), np.int64), np.zeros(3000, np.int64)
    counts = np.bincount(kernel.decide(codes, at, np.ones(3000, bool), style, moves), minlength=4)
    assert counts[1] == counts[2] == 0
    assert abs(int(counts[0]) - 1500) < 150


def test_populations_differ_as_their_names_say():
    found = {
        name: true_level(CONFIG, SEEDS, population, 2000, 4)
        for name, population in SIMULATED_POPULATIONS.items()
    }
    assert found["skilled"].mean_score > found["mixed"].mean_score > found["clumsy"].mean_score
    assert found["skilled"].mean_steps < found["mixed"].mean_steps < found["clumsy"].mean_steps
    assert found["skilled"].collisions == 0 < found["mixed"].collisions < found["clumsy"].collisions
    again = true_level(CONFIG, SEEDS, SIMULATED_POPULATIONS["clumsy"], 2000, 5)
    assert abs(again.mean_score - found["clumsy"].mean_score) < 4 * 2**0.5 * again.score_error
    assert abs(again.mean_steps - found["clumsy"].mean_steps) < 4 * 2**0.5 * again.steps_error


def coverage(config, seeds, population, count, players, episodes=10_000):
    """The truth of a population, and the shares of simulated studies whose printed and t interval cover it."""
    truth = true_level(config, seeds, population, episodes, 1)
    played = play_studies(config, seeds, population, (count, players), 2)
    shares = {}
    for name, values, true in (
        ("score", played.score, truth.mean_score),
        ("steps", played.steps_to_99, truth.mean_steps),
    ):
        means = values.mean(2)
        for how, ends in (("printed", printed_interval(means)), ("t", t_interval(means))):
            shares[name, how] = float(np.mean((ends[0] <= true) & (true <= ends[1])))
    return truth, shares


def test_intervals_of_small_simulated_studies_cover_the_truth():
    _, shares = coverage(CONFIG, SEEDS, SIMULATED_POPULATIONS["clumsy"], 100, 10, 4000)
    assert all(share >= 0.88 for (_, how), share in shares.items() if how == "printed"), shares


@pytest.mark.long
@pytest.mark.parametrize("name", SIMULATED_POPULATIONS)
def test_intervals_of_two_hundred_whole_studies_cover_the_truth(name):
    config, seeds = EnvConfig.of("random", 21), range(900, 930)
    truth, shares = coverage(config, seeds, SIMULATED_POPULATIONS[name], 200, 10)
    print(name, truth, shares)
    assert all(share >= 0.915 for (_, how), share in shares.items() if how == "printed"), (
        shares
    )  # 3 SE below 0.95 is 0.904


def test_a_persona_is_the_same_whenever_it_is_asked_for():
    one, two = (draw_persona(3, "reloader", SIMULATED_POPULATIONS["mixed"], 8) for _ in range(2))
    assert one == two
    assert one.style("ranked", 4) == two.style("ranked", 4)
    styles = {
        one.style(phase, trial).stream for phase in ("warm_up", "ranked") for trial in range(20)
    }
    assert len(styles) == 40
    assert (
        draw_persona(4, "reloader", SIMULATED_POPULATIONS["mixed"], 8).slip_logit != one.slip_logit
    )


def test_personas_are_drawn_from_their_population():
    slips = [
        draw_persona(number, "idler", SIMULATED_POPULATIONS["clumsy"], 8).style("ranked", 0).slip
        for number in range(400)
    ]
    whole = draw_players(
        SIMULATED_POPULATIONS["clumsy"], 4000, np.random.default_rng(0)
    ).draw_episodes(np.arange(4000), np.random.default_rng(1))[0]
    error = (np.var(slips) / 400 + np.var(whole) / 4000) ** 0.5
    assert abs(np.mean(slips) - whole.mean()) < 4 * error


def test_kinds_are_assigned_in_turn():
    assert assign_kinds(("idler", "random"), 3) == ("idler", "random", "idler")
    assert set(assign_kinds(("mixed",), 10)) == set(PLAYER_KINDS)
