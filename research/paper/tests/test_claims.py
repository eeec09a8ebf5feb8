"""docs/paper.md says what is stored, and its verdicts follow from the numbers."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode, score
from marsexplorer.intervals import t_interval
from marsexplorer.terrain import generate
from research.difference import answers
from research.difference.design import Training
from research.paper import second_reading
from research.paper.algorithms import ALGORITHMS, begin
from research.paper.claims import checks, page, settings_table, training_claims
from research.paper.claims.claims import CLAIMS, FINDINGS, fast
from research.paper.claims.code_claims import by_code
from research.paper.claims.hours import LARGE, LEVELS, RANDOM, hours, to_decide
from research.paper.claims.results import (
    CONTRARY,
    FOLDER,
    NOT_REPRODUCED,
    NOT_YET,
    PARTLY,
    REPRODUCED,
    SLIP,
    UNDECIDED,
    VERDICTS,
    Results,
    above_by_seed,
    all_of,
    certainly_above,
    ratio_of_means,
    read,
)
from research.paper.claims.training_claims import NONE_YET, millions, with_bonus
from research.paper.episodes.play import DIFFICULTIES
from research.paper.figures.curves import TITLES, Record, count_text
from research.paper.plan import BUDGETS, LEVEL_MOVES
from research.paper.trial import ENDINGS, Trial

DOCUMENT, TRAININGS = page.PAGES
MEASURED = {"score": 0.5, "coverage": 0.9, "steps": 100.0, "best_rule_steps": 80.0}
SETTINGS = {"num_envs": 20, "num_steps": 200, "update_epochs": 30, "minibatch_size": 128}
LIGHT = SETTINGS | {"update_epochs": 6, "minibatch_size": 500}
HARDWARE = "x86_64, some processor, one thread"
LONG = 10**8
"""Moves, more than any budget has."""
FINALS = {"ppo": 0.8, "rainbow": 0.4, "a2c": 0.2, "sac": 0.1}
"""Final scores as the paper has them in order."""
FIGURE_4 = ("best", "second", "half")
FIGURE_5 = ("morphology-first", "morphology-degrades", "bonus-little", "hardest")


def trained(
    algorithm, seed, scores, level="random", variant="paper", explored=None, completion=0.0
):
    """A long finished trial with a curve of these scores.

    Its points are 1,000 moves and 10 CPU seconds apart.

    explored  the share of completed episodes; None: the one with which a score is the same with a bonus and without
    """
    points = range(1, len(scores) + 1)
    curve = {"moves": [1000 * k for k in points], "cpu_s": [10.0 * k for k in points]}
    curve |= {name: [0.0 for _ in points] for name in ENDINGS}
    curve |= {"score": scores, "coverage": scores}
    curve["explored"] = [2 * score - 1 if explored is None else explored for score in scores]
    result = MEASURED | {"moves": LONG, "cpu_s": 60.0, "completion": completion}
    trial = Trial(algorithm, variant, level, 21, seed, LONG)
    return Record(trial, SETTINGS, {"hardware": HARDWARE}, curve, result)


def verdicts_of(names, results):
    return [CLAIMS[name].decide(results).verdict for name in names]


def verdict_of(name, results):
    return CLAIMS[name].decide(results).verdict


def figure_4(finals=FINALS, seeds=3):
    return [
        trained(name, seed, [0.1, value + 0.01 * seed])
        for name, value in finals.items()
        for seed in range(seeds)
    ]


def of_moves(records, moves):
    return [replace(record, trial=replace(record.trial, moves=moves)) for record in records]


def test_every_claim_has_its_row_and_every_row_its_claim():
    names = [name for document in page.PAGES for name in page.names_of(document.read_text())]
    assert sorted(names) == sorted(CLAIMS)
    assert {*page.names_of(DOCUMENT.read_text())} >= FINDINGS


def test_the_pages_are_what_the_shipped_results_draw():
    results = read()
    for document in page.PAGES:
        text = document.read_text()
        assert page.redraw(text, results) == text, "run python -m research.paper.claims.page"


def test_a_second_reading_of_the_stored_files_finds_the_figures_of_the_page():
    rows = second_reading.compare()
    assert len(rows) > 30
    assert {name: page for name, page, _ in rows} == {name: derived for name, _, derived in rows}


def test_every_picture_of_the_page_lies_there_and_is_small():
    both = DOCUMENT.read_text() + TRAININGS.read_text()
    shown = re.findall(r"^!\[.*\]\((pictures/paper/.*)\)$", both, re.M)
    lying = sorted(
        f"pictures/paper/{path.name}" for path in (DOCUMENT.parent / "pictures" / "paper").iterdir()
    )
    assert sorted(shown) == lying
    assert all((DOCUMENT.parent / name).stat().st_size < 500_000 for name in shown)


def test_other_results_draw_another_page():
    text = DOCUMENT.read_text()
    drawn = page.redraw(text, Results(records=figure_4()))
    assert re.search(r"^\|`best`\|.*ppo 0\.810 ± 0\.025.*\|reproduced\|\|\|$", drawn, re.M)
    assert re.search(r"^\|`second`\|.*\|reproduced\|\|\|$", drawn, re.M)
    assert re.search(
        r"^\|`hilbert`\|[^|]*\|`[^|]*`\|not yet measured\|not yet measured\|\|$", drawn, re.M
    )
    definitions = page.redraw(TRAININGS.read_text(), Results(trainings=read().trainings))
    assert re.search(r"^\|`actions`\|.*\|not yet measured\|$", definitions, re.M)
    assert page.redraw(drawn, read()) == text


RULES_THERE = [
    {"policy": "frontier-cost", "clean_u": 0.3, "terrains": 200},
    {"policy": "frontier-utility", "clean_u": 0.6, "terrains": 200},
]


def in_the_codes_world(shares, passes="full", leaving="free", **kind):
    """Finished trainings there, of which a seed each has a share of its episodes."""
    records = {}
    for seed, share in enumerate(shares):
        training = Training(
            kind.get("world", "code"), kind.get("estimates", "code"), leaving, seed, passes
        )
        result = {"clean_u": share, "covers_most": share}
        records[training] = answers.Record(training, (), (), result)
    return records


def by_the_code(name, records):
    return by_code(name, Results(trainings=records, code_rules=RULES_THERE))


NEVER, SELDOM, OFTEN, ALWAYS = [0.0] * 3, [0.1, 0.12, 0.11], [0.8, 0.81, 0.82], [0.98, 0.99, 1.0]


@pytest.mark.parametrize(
    ("passes", "shares", "of_u", "of_new_terrains"),
    [
        ("full", ALWAYS, PARTLY, PARTLY),
        ("light", ALWAYS, PARTLY, PARTLY),
        ("full", OFTEN, PARTLY, NOT_REPRODUCED),
        ("light", OFTEN, PARTLY, CONTRARY),
        ("full", [0.62, 0.63, 0.64], UNDECIDED, NOT_REPRODUCED),  # not above the better rule
        ("full", SELDOM, NOT_REPRODUCED, NOT_REPRODUCED),
        ("light", SELDOM, CONTRARY, CONTRARY),
        ("full", NEVER, NOT_REPRODUCED, NOT_REPRODUCED),
        ("full", [0.1, 0.99, 0.1], UNDECIDED, UNDECIDED),  # one seed is not the policy
        ("full", [0.99], UNDECIDED, UNDECIDED),
        ("full", [], NOT_YET, NOT_YET),
    ],
)
def test_a_finding_is_judged_in_the_codes_world_by_all_seeds(passes, shares, of_u, of_new_terrains):
    records = in_the_codes_world(shares, passes)
    assert re.match(r"[a-z ,]+", by_the_code("hilbert", records))[0] == of_u
    assert re.match(r"[a-z ,]+", by_the_code("generalises", records))[0] == of_new_terrains


def test_the_codes_world_is_judged_with_its_shares_and_those_of_the_rules():
    words = by_the_code("hilbert", in_the_codes_world([0.1, 0.99, 0.1]))
    assert words == (
        "undecided: a U without going back in 10.0 to 99.0 %; "
        "`frontier-cost` 30.0 %, `frontier-utility` 60.0 %"
    )
    without_rules = Results(trainings=in_the_codes_world(ALWAYS))
    assert by_code("hilbert", without_rules) == NOT_YET
    assert by_the_code("hilbert", {}) == NOT_YET
    assert by_code("best", without_rules) == ""


def test_full_passes_by_the_code_where_leaving_is_free_judge_where_there_are_some():
    full = in_the_codes_world(SELDOM)
    others = [
        in_the_codes_world(ALWAYS, "light"),
        in_the_codes_world(ALWAYS, leaving="costs"),
        in_the_codes_world(ALWAYS, world="text"),
        in_the_codes_world(ALWAYS, estimates="text"),
    ]
    for other in others:
        assert by_the_code("generalises", other | full).startswith("not reproduced: ")
    unfinished = {
        training: replace(record, result=None)
        for training, record in in_the_codes_world(ALWAYS).items()
    }
    assert by_the_code("generalises", unfinished) == NOT_YET


def test_hours_are_of_what_is_not_trained_yet():
    whole = hours(RANDOM, Results(), 20.0)
    assert whole == pytest.approx(3 * 2250 * 20 / 3600)
    trial = Trial("ppo", "appendix", "random", 21, 0, 9_000_000)
    begun = Results(unfinished=[{"trial": trial, "moves": 4_500_000}])
    assert hours(RANDOM, begun, 20.0) == pytest.approx(whole - 1125 * 20 / 3600)
    assert to_decide("best", UNDECIDED, begun).startswith("PPO on `random`: ")
    assert to_decide("best", CONTRARY, begun) == to_decide("best", UNDECIDED, begun)
    assert to_decide("best", REPRODUCED, begun) == to_decide("hilbert", UNDECIDED, begun) == ""
    # a grid of four and of sixteen times the cells, 200 updates and three seeds each
    assert hours(LARGE, begun, 20.0) == pytest.approx(3 * 200 * (4 + 16) * 20 / 3600)
    # a training that ends takes no hours, and neither does one of another kind
    ended = trained("ppo", 0, [0.5], variant="appendix")
    light = trained("ppo", 1, [0.5])
    done = Results(records=[ended, light], unfinished=begun.unfinished)
    assert hours(RANDOM, done, 20.0) == pytest.approx(whole * 2 / 3)
    assert hours(LEVELS, done, 20.0) == pytest.approx(12 * 3 * 200 * 20 / 3600)
    all_ended = [trained("ppo", seed, [0.5], variant="appendix") for seed in range(3)]
    assert to_decide("best", UNDECIDED, Results(records=all_ended)) == ""


def test_trainings_with_the_papers_gradient_steps_decide_when_all_have_ended():
    """What the hours are of is what the verdict waits for."""
    light = [
        replace(record, settings=LIGHT, result=record.result | {"moves": 9_000_000})
        for record in figure_4(FINALS | {"ppo": 0.05})
    ]
    assert verdict_of("best", Results(records=light)) == CONTRARY
    full = [trained("ppo", seed, [0.1, 0.05 + 0.01 * seed], variant="appendix") for seed in (0, 1)]
    assert verdict_of("best", Results(records=[*light, *full])) == CONTRARY
    full.append(trained("ppo", 2, [0.1, 0.07], variant="appendix"))
    assert verdict_of("best", Results(records=[*light, *full])) == NOT_REPRODUCED


def test_the_pages_say_of_other_levels_what_they_are():
    words = training_claims.levels_in_short(figure_5(*LIKE_THE_PAPER, ("paper", "works")))
    assert (
        "By the letter, each training on a level has 100 M moves and 24 M gradient steps" in words
    )
    assert "in 1.25 of the better rule's moves" in " ".join(words.split())
    assert "As it works, it completes 0 % of a level's terrains" in " ".join(words.split())


def test_trainings_that_became_a_constant_move_are_those_with_its_results():
    east = training_claims.constant_actions()["east"]
    assert sum(east[ending] for ending in ENDINGS) == pytest.approx(1)
    other = east | {"coverage": east["coverage"] + 0.01}
    endings = [("paper", east), ("appendix", east), ("paper", other), ("works", east)]
    records = [
        replace(record, result=record.result | shares)
        for seed, (variant, shares) in enumerate(endings)
        for record in [trained("ppo", seed, [0.5], variant=variant)]
    ]
    assert training_claims.became(Results(records=records)) == (
        "Of 3 trainings by the letter, 2 became a constant move: PPO always east 2."
    )
    assert training_claims.became(Results(records=records[2:3])) == (
        "Of 1 training by the letter, 0 became a constant move: none."
    )


def test_trainings_under_way_are_listed_with_their_moves():
    trial = Trial("ppo", "appendix", "random", 21, 2, 9_000_000)
    line = {"coverage": 0.25, "explored": 0.125}
    begun = {"trial": trial, "moves": 4_500_000, "line": line}
    table = training_claims.unfinished(Results(unfinished=[begun, begun | {"line": {}}]))
    assert table.splitlines()[2:] == [
        "| PPO appendix | 2 | 4.5 M of 9 M | 0.250 | 0.125 |",
        "| PPO appendix | 2 | 4.5 M of 9 M |  |  |",
    ]
    assert training_claims.unfinished(Results()) == "None is under way."


def test_the_checks_of_the_environment_find_what_is_shipped():
    shipped = [json.loads(line) for line in (FOLDER / "environment.jsonl").read_text().splitlines()]
    assert checks.run() == shipped


@pytest.fixture
def fresh_terrains():
    checks.drawn.cache_clear()
    yield
    checks.drawn.cache_clear()


class MirroredEpisode(Episode):
    """Steps the other way."""

    def step(self, action):
        return super().step(3 - action)


class OpenEpisode(Episode):
    """Shows the whole terrain, and the rover as 0.5."""

    def observation(self):
        matrix = super().observation()
        matrix[self.terrain] = 1.0
        matrix[self.position] = 0.5
        return matrix


class OtherConfig(EnvConfig):
    """Without ends that pay, with the authors' order of d_b, and larger than is said."""

    def __new__(cls, *sides, **fields):
        return EnvConfig.of("1-1-2")

    @staticmethod
    def of(level="random", size=21):
        swapped = level[:-1] + {"1": "2", "2": "1"}.get(level[-1], level[-1])
        return EnvConfig.of(swapped, size + 1)


def on_one_level(config, seed):
    return generate(EnvConfig.of("2-1-1", config.rows), seed)


def played_blindly(config, policy, count, played=checks.played):
    return played(config, "blind", count)


CHANGES = {
    "actions": ("Episode", MirroredEpisode),
    "lidar": ("Episode", OpenEpisode),
    "state": ("Episode", OpenEpisode),
    "partial-observability": ("Episode", OpenEpisode),
    "reward": ("R_MOVE", 0.2),
    "invalid": ("EnvConfig", OtherConfig),
    "bonus": ("EnvConfig", OtherConfig),
    "table-1": ("EnvConfig", lambda: EnvConfig.of("random", 42)),
    "diversity": ("generate", lambda config, seed: generate(config, seed % 500)),
    "random-obstacles": ("generate", on_one_level),
    "score-zero": ("score", lambda config, total: total / config.n),
    "score-one": ("score", lambda config, total: total / config.n),
    "shares": ("PRINTED", 0.4293),
    "lattice": ("generate", lambda config, seed: generate(EnvConfig(), seed)),
    "topology": ("generate", on_one_level),
    "morphology": ("generate", on_one_level),
    "bonus-levels": ("EnvConfig", OtherConfig),
    "combinations": ("DIFFICULTIES", DIFFICULTIES[1:]),
    "structure": ("generate", on_one_level),
    "discovered-obstacles": ("played", played_blindly),
    "sizes": ("EnvConfig", OtherConfig),
    "cost": ("COST_RULE", "frontier-utility"),
}
"""Check -> what it asks of the world, and another world's answer."""


def test_every_check_has_a_world_in_which_it_fails():
    assert [*CHANGES] == [*checks.CHECKS]


@pytest.mark.usefixtures("fresh_terrains")
@pytest.mark.parametrize("name", CHANGES)
def test_a_check_fails_in_another_world(name, monkeypatch):
    attribute, other = CHANGES[name]
    monkeypatch.setattr(checks, attribute, other)
    (line,) = checks.run([name])
    assert line["holds"] == (name == "shares")  # which do not belong together in the paper's


@pytest.mark.parametrize("name", [name for name in CHANGES if name != "discovered-obstacles"])
def test_a_check_decides_its_claim(name):
    verdicts = {True: REPRODUCED, False: SLIP if name == "shares" else NOT_REPRODUCED}
    for holds, verdict in verdicts.items():
        line = {"holds": holds, "measured": "so many"}
        assert verdict_of(name, Results(checks={name: line})) == verdict


def test_the_speed_is_judged_by_what_the_page_of_results_wants():
    row = "|through `gymnasium.make`, uint8 codes|{}|400,000|\n"
    assert fast(row.format("499,007")).verdict == REPRODUCED
    assert fast(row.format("399,999")).verdict == NOT_REPRODUCED
    assert fast("no row").verdict == NOT_YET


def test_what_holds_an_algorithm_back_is_what_costs_most_to_leave_out():
    shares = {
        "paper": 0.0,
        "works": 0.95,
        "works-no-mask": 0.1,
        "tuned": 1.0,
        "tuned-no-mask": 0.9,
        "tuned-no-reward": 0.9,
        "paper+mask": 0.02,
        "paper-no-bonus": 0.01,
    }
    results = Results(
        records=[
            trained("sac", seed, [0.5], variant=name, completion=share)
            for name, share in shares.items()
            for seed in range(3)
        ]
    )
    assert training_claims.ablations(results).splitlines()[2:] == [
        "| SAC | `mask` | 10 ± 0 % | 90 ± 0 % | 2 ± 0 % |  | 3 x 200, 100 M |",
        "| SAC | `reward` |  | 90 ± 0 % |  |  | 3 x 200, 100 M |",
        "| SAC | `bonus` |  |  |  | 1 ± 0 % | 3 x 200, 100 M |",
    ]
    shorter = [
        *of_moves(results.records[3:6], 600_000),
        *of_moves([trained("sac", 0, [0.5], variant="works-no-mask")], 600_000),
        trained("sac", 0, [0.5], variant="tuned-no-mask"),
    ]
    assert training_claims.ablations(Results(records=shorter)).endswith(
        " | 1 x 200, 600 k; 1 x 200, 100 M |"
    )
    first, _, *table = training_claims.trained(results).splitlines()
    assert first.startswith("In all rows: algorithm SAC, level random, seeds 3, ")
    assert [line.split(" | ")[0] for line in table[2:]] == ["| paper", "| works", "| tuned"]
    assert training_claims.levels_in_short(results) == training_claims.NONE_YET


def test_an_unknown_check_is_an_error_that_names_the_others(capsys):
    with pytest.raises(SystemExit):
        checks.main(["rewards"])
    assert re.search(
        "'rewards' is not one of 'actions', 'lidar', 'state', 'partial-observability',",
        capsys.readouterr().err,
    )


@pytest.mark.parametrize(
    ("finals", "verdicts"),
    [
        (FINALS, [REPRODUCED] * 3),
        (
            {"ppo": 0.3, "rainbow": 0.4, "a2c": 0.5, "sac": 0.1},
            [NOT_REPRODUCED, REPRODUCED, NOT_REPRODUCED],
        ),
        (FINALS | {"sac": 0.5, "a2c": 0.6}, [REPRODUCED, NOT_REPRODUCED, REPRODUCED]),
        (FINALS | {"rainbow": 0.9}, [NOT_REPRODUCED, NOT_REPRODUCED, NOT_REPRODUCED]),
        # within the noise: PPO and Rainbow, Rainbow and A2C, PPO and A2C
        (FINALS | {"ppo": 0.405}, [UNDECIDED, UNDECIDED, NOT_REPRODUCED]),
        (FINALS | {"ppo": 0.395}, [UNDECIDED, UNDECIDED, NOT_REPRODUCED]),
        (FINALS | {"a2c": 0.405}, [REPRODUCED, UNDECIDED, REPRODUCED]),
        (FINALS | {"a2c": 0.395}, [REPRODUCED, UNDECIDED, REPRODUCED]),
        (FINALS | {"a2c": 0.805}, [UNDECIDED, NOT_REPRODUCED, REPRODUCED]),
    ],
)
def test_figure_4_is_judged_by_who_is_best_and_second_with_certainty(finals, verdicts):
    assert verdicts_of(FIGURE_4, Results(records=figure_4(finals))) == verdicts


def test_a_statement_holds_where_all_its_parts_do_and_fails_where_one_does_not():
    assert all_of([]) is all_of([True, True]) is True
    assert all_of([True, None]) is None
    assert all_of([None, False, True]) is False
    high, low, wide = (
        np.array([3.0, 3.1, 3.2]),
        np.array([1.0, 1.2, 1.1]),
        np.array([0.0, 3.0, 6.0]),
    )
    for above in (certainly_above, above_by_seed):
        assert (above(high, low), above(low, high), above(high, wide)) == (True, False, None)
    # what seeds share is no noise of their difference
    assert above_by_seed(wide + 0.01, wide) is True
    assert certainly_above(wide + 0.01, wide) is None
    assert above_by_seed(high, low, 2.5) is False


def test_a_ratio_of_means_has_fiellers_interval():
    # 4 degrees of freedom, t 2.7764: (10 - 5 r)^2 = t^2 (4/3 + r^2 / 3)
    ratio = ratio_of_means(np.array([8.0, 10.0, 12.0]), np.array([4.0, 5.0, 6.0]))
    assert (ratio.mean, ratio.low, ratio.high) == pytest.approx((2.0, 1.2447, 3.2134), abs=2e-4)
    # over a constant, and of one, it is the t interval of the other
    two, values = np.array([2.0, 2.0, 2.0]), np.array([4.0, 5.0, 6.0])
    low, high = t_interval(values)
    ratio = ratio_of_means(values, two)
    assert (ratio.low, ratio.high) == pytest.approx((low / 2, high / 2))
    ratio = ratio_of_means(two, values)
    assert (ratio.low, ratio.high) == pytest.approx((2 / high, 2 / low))
    ratio = ratio_of_means(values, np.array([-1.0, 1.0, 2.0]))  # which may be 0
    assert (ratio.mean, ratio.low, ratio.high) == (7.5, -np.inf, np.inf)
    assert ratio_of_means(values, np.array([-1.0, 0.0, 1.0])).high == np.inf
    assert ratio_of_means(two, two).high == 1.0


def test_a_ratio_whose_interval_is_not_bounded_decides_nothing_and_says_so():
    finals = {
        "ppo": (0.01, 0.2, 0.5),
        "rainbow": (0.1, 0.11, 0.12),
        "a2c": (0.1,) * 3,
        "sac": (0.1,) * 3,
    }
    records = [
        trained(name, seed, [0.1, score])
        for name, scores in finals.items()
        for seed, score in enumerate(scores)
    ]
    judgement = CLAIMS["half"].decide(Results(records=records))
    assert judgement.verdict == UNDECIDED
    assert (
        "ratio of the means of these scores at the end 0.465, and no bounded interval"
        in judgement.measured
    )
    bounded = CLAIMS["half"].decide(Results(records=figure_4()))
    assert re.search(r"scores at the end 0\.506 \(0\.\d+ to 0\.\d+\)\.", bounded.measured)


def test_the_moves_that_trainings_need_are_said_without_a_verdict():
    assert millions(Results()) == NONE_YET
    records = [trained(name, 0, [0.9], variant="works", explored=0.95) for name in ALGORITHMS]
    slow = trained("sac", 1, [0.9], variant="works", explored=0.5)
    by_letter = [trained("ppo", seed, [0.1], explored=0.1 + 0.85 * seed) for seed in (0, 1)]
    sentence = " ".join(millions(Results(records=[*records, slow, *by_letter])).split())
    moves = count_text(records[0].curve["moves"][-1])
    needed = ", ".join(f"{name} {moves}" for name in ("PPO", "A2C", "Rainbow"))
    assert f"after at most {needed} moves, and by the letter 1 of 2 trainings" in sentence


def test_too_few_seeds_or_algorithms_decide_nothing():
    three = {name: value for name, value in FINALS.items() if name != "sac"}
    for records in (figure_4(seeds=2), figure_4(three)):
        assert verdict_of("best", Results(records=records)) == NOT_YET


def test_only_the_longest_trainings_count_of_which_there_are_three():
    short = [
        replace(record, curve={**record.curve, "score": [0.5, 0.5]})
        for record in of_moves(figure_4(), 10)
    ]
    longer = of_moves([trained("ppo", 0, [0.0, 0.0])], 2 * LONG)
    assert verdict_of("best", Results(records=[*short, *figure_4(), *longer])) == REPRODUCED


def test_short_trainings_are_shown_and_decide_nothing():
    results = Results(records=of_moves(figure_4(), BUDGETS["full"].moves["sac"] - 1))
    for name in FIGURE_4:
        judgement = CLAIMS[name].decide(results)
        assert judgement.verdict == NOT_YET
        assert judgement.measured.startswith("after short trainings, which decide nothing: ")


def test_trainings_that_are_shorter_than_the_papers_decide_nothing_and_say_how_long_they_are():
    records = [
        replace(
            record,
            result=record.result
            | {"moves": 8_999_999 if record.trial.algorithm == "ppo" else LONG},
        )
        for record in figure_4()
    ]
    for name in FIGURE_4:
        judgement = CLAIMS[name].decide(Results(records=records))
        assert judgement.verdict == UNDECIDED
        assert "PPO 9 M and 2.16 M" in judgement.measured
        assert "moves of the paper's: PPO 9 M" in judgement.measured
        assert judgement.measured.endswith("its PPO made 2.16 M gradient steps")
    whole = [record for record in figure_4() if record.trial.algorithm != "ppo"]
    exact = [
        replace(record, settings=LIGHT, result=record.result | {"moves": 9_000_000})
        for record in figure_4()
    ]
    judgement = CLAIMS["best"].decide(Results(records=[*whole, *exact[:3]]))
    assert judgement.verdict == REPRODUCED
    assert "PPO 9 M and 108 k" in judgement.measured  # of as many moves, but not of as many steps


def test_that_a_statement_does_not_hold_takes_the_gradient_steps_of_the_paper_too():
    """Its moves alone show that one holds."""
    for finals, with_steps in ((FINALS, REPRODUCED), (FINALS | {"ppo": 0.05}, NOT_REPRODUCED)):
        records = figure_4(finals)
        assert verdict_of("best", Results(records=records)) == with_steps
        light = [
            replace(record, settings=LIGHT, result=record.result | {"moves": 9_000_000})
            for record in records
        ]
        without = REPRODUCED if with_steps == REPRODUCED else CONTRARY
        assert verdict_of("best", Results(records=light)) == without


def test_a_slip_of_the_paper_is_no_failure_to_reproduce_it():
    slip = CLAIMS["shares"].decide(read())
    assert slip.verdict == SLIP
    assert slip.brief == slip.measured


def test_no_order_at_equal_cpu_time_is_said_where_times_or_processors_are_not_known_or_differ():
    first, *others = figure_4()
    assert "at equal CPU time" in CLAIMS["best"].decide(Results(records=[first, *others])).measured
    for other in (
        replace(first, curve={**first.curve, "cpu_s": [None] * len(first.curve["moves"])}),
        replace(first, versions={"hardware": "x86_64, another processor, one thread"}),
    ):
        measured = CLAIMS["best"].decide(Results(records=[other, *others])).measured
        assert "at equal moves" in measured
        assert "at equal CPU time" not in measured
    for unknown in ({"hardware": "x86_64, one thread"}, {"hardware": None}, {}):
        records = [replace(record, versions=unknown) for record in (first, *others)]
        assert "at equal CPU time" not in CLAIMS["best"].decide(Results(records=records)).measured


def test_a_curve_that_has_not_begun_has_no_score():
    late = [
        replace(record, curve={**record.curve, "moves": [5000, 6000]})
        if record.trial.algorithm == "a2c"
        else record
        for record in figure_4()
    ]
    measured = CLAIMS["best"].decide(Results(records=late)).measured
    assert "a2c too early to say; at equal CPU time" in measured


def figure_5(topology, morphology, bonus, variants=("paper",)):
    """Results of the 12 levels whose final scores have these effects."""

    def score(level):
        t, m, b = map(int, level.split("-"))
        return 0.95 - topology * (t - 1) - morphology * (m - 1) - bonus * (b - 1)

    return Results(
        records=[
            trained("ppo", seed, [score(level) + 0.001 * seed], level, variant)
            for variant in variants
            for level in DIFFICULTIES
            for seed in range(3)
        ]
    )


LIKE_THE_PAPER, UNLIKE = (0.02, 0.28, 0.01), (0.2, 0.0, 0.3)


def test_figure_5_is_judged_by_the_effects_of_the_three_elements():
    assert verdicts_of(FIGURE_5, figure_5(*LIKE_THE_PAPER)) == [REPRODUCED] * 4
    assert verdicts_of(FIGURE_5, figure_5(*UNLIKE)) == [NOT_REPRODUCED] * 4
    light = [
        replace(record, settings=LIGHT, result=record.result | {"moves": LEVEL_MOVES})
        for record in figure_5(*UNLIKE).records
    ]
    assert verdicts_of(FIGURE_5, Results(records=light)) == [CONTRARY] * 4


def test_the_summary_says_what_a_finding_comes_to():
    results = figure_5(0.02, 0.05, 0.01, ("paper", "works"))
    summary = page.summary(DOCUMENT.read_text(), results)
    loss = "d_m = 2 costs 0.050 ± 0.000 by the letter, 0.050 ± 0.000 as it works; "
    loss += "0.1 counts as serious"
    assert re.search(rf"`morphology-degrades`\): {loss}$", summary, re.M)


def shaken(results, shifts):
    """The same with a shift of the score for each seed, on some levels.

    Those on which an element of the difficulty has its last value.
    """

    def score(record):
        element, shift = shifts[0], shifts[1][record.trial.seed]
        is_last = record.trial.level.split("-")[element] == "322"[element]
        return record.curve["score"][-1] + shift * is_last

    return Results(
        records=[
            trained("ppo", record.trial.seed, [score(record)], record.trial.level)
            for record in results.records
        ]
    )


NOISE = (-0.03, 0.0, 0.03)
"""By which an effect varies over seeds: a mean of three has an interval of 0.075 then."""


@pytest.mark.parametrize(
    ("bonus", "verdict"), [(0.02, REPRODUCED), (0.1, UNDECIDED), (0.24, NOT_REPRODUCED)]
)
def test_an_effect_is_smaller_or_larger_than_the_others_only_with_certainty(bonus, verdict):
    results = shaken(figure_5(0.06, 0.3, bonus), (2, NOISE))  # d_t has 0.12
    assert verdict_of("bonus-little", results) == verdict
    assert verdict_of("morphology-first", results) == (UNDECIDED if bonus == 0.24 else REPRODUCED)


@pytest.mark.parametrize(
    ("loss", "verdict"), [(0.2, REPRODUCED), (0.12, UNDECIDED), (0.02, NOT_REPRODUCED)]
)
def test_a_loss_is_serious_only_with_certainty(loss, verdict):
    results = shaken(figure_5(0.01, loss, 0.01), (1, NOISE))
    assert verdict_of("morphology-degrades", results) == verdict


def test_a_score_lies_in_a_range_only_with_certainty():
    assert verdict_of("hardest", shaken(figure_5(*LIKE_THE_PAPER), (1, NOISE))) == UNDECIDED


def test_a_loss_is_of_scores_on_one_scale():
    records = [
        trained("ppo", seed, [0.5 - 0.12 * (level[2] == "2") + 0.0001 * seed], level, explored=0.0)
        for level in DIFFICULTIES
        for seed in range(3)
    ]
    judgement = CLAIMS["morphology-degrades"].decide(Results(records=records))
    assert judgement.verdict == NOT_REPRODUCED
    assert (
        "a certain loss of 0.080 ± 0.000, less than the 0.1 that counts as serious"
        in judgement.measured
    )


def test_a_level_without_bonus_is_compared_on_the_scale_of_those_with_it():
    scores = {("1", "1"): 0.945, ("2", "1"): 0.939, ("1", "2"): 0.836, ("2", "2"): 0.818}
    results = Results(
        records=[
            trained("ppo", seed, [scores[level[2], level[4]] + 0.0001 * seed], level, "works", 1.0)
            for level in DIFFICULTIES
            for seed in range(3)
        ]
    )
    assert "d_b 0.000 ± 0.000; by seed" in CLAIMS["morphology-first"].decide(results).measured
    assert verdicts_of(FIGURE_5[:3], results) == [UNDECIDED, CONTRARY, CONTRARY]


def test_the_bonus_is_counted_by_how_the_episodes_end():
    config = EnvConfig.of("1-2-2", 21)
    ends = {"explored": 0.5, "collided": 0.25, "out_of_bounds": 0.125}
    record = trained("ppo", 0, [score(config, 300.0)], "1-2-2")
    record = replace(record, curve=record.curve | {name: [share] for name, share in ends.items()})
    assert with_bonus(record) == pytest.approx(
        score(EnvConfig.of("1-2-1", 21), 300.0 + 441 * (0.5 - 0.375))
    )
    same = trained("ppo", 0, [0.7], "1-2-1", explored=0.3)
    assert with_bonus(same) == pytest.approx(0.7)


def test_what_happens_on_the_levels_as_it_works_alone_decides_nothing():
    for effects, words in (
        (LIKE_THE_PAPER, ", as the paper says."),
        (UNLIKE, ", not as the paper says."),
    ):
        works = CLAIMS["hardest"].decide(figure_5(*effects, ["works"]))
        assert works.verdict == (UNDECIDED if effects == LIKE_THE_PAPER else CONTRARY)
        assert works.measured.startswith("as it works: final score: 3-2-1 0.")
        assert words in works.measured
    assert verdict_of("hardest", figure_5(*LIKE_THE_PAPER, ["paper", "works"])) == REPRODUCED


def test_what_was_trained_on_one_level_is_judged_on_the_others():
    def played(moves, seeds=3):
        return Results(
            plays={
                8: [
                    {
                        "policy": f"ppo-works-{on}-21-s{seed}",
                        "level": level,
                        "played": 10,
                        "outcomes": {"explored": 9, "timed_out": 1},
                        "steps_to_99": steps + 0.1 * seed,
                    }
                    for on, steps in moves.items()
                    for seed in range(seeds)
                    for level in DIFFICULTIES
                ]
            }
        )

    moves = {"1-1-1": 95.0, "1-1-2": 94.0, "3-2-1": 90.0, "3-2-2": 91.0}
    judgement = CLAIMS["harder-generalises"].decide(played(moves))
    assert judgement.verdict == PARTLY
    assert (
        "trained on 1-1-1 or 1-1-2 94.6 ± 0.6 (6 trainings), trained on 3-2-1 or 3-2-2 90.6"
        in judgement.measured
    )
    # one pair of levels is not the paper's statement: both levels of a kind count
    picked = moves | {"1-1-2": 90.0, "3-2-2": 94.0}
    assert verdict_of("harder-generalises", played(picked)) == UNDECIDED
    turned = {"1-1-1": 90.0, "1-1-2": 91.0, "3-2-1": 95.0, "3-2-2": 94.0}
    assert verdict_of("harder-generalises", played(turned)) == CONTRARY
    assert verdict_of("harder-generalises", played(moves, seeds=1)) == UNDECIDED
    assert verdict_of("harder-generalises", played({"1-1-1": 95.0})) == NOT_YET


def test_few_terrains_to_train_on_are_compared_with_new_ones_in_every_episode():
    shares = {"works@10": 0.4, "works@100": 0.8, "works@1000": 0.9, "works": 1.0}
    records = [
        trained("ppo", seed, [0.5], variant=variant, completion=share - 0.01 * seed)
        for variant, share in shares.items()
        for seed in range(3)
    ]
    judgement = CLAIMS["generalises"].decide(Results(records=records))
    assert judgement.verdict == PARTLY
    words = "10: 39 ± 2 % and 100 ± 0; 100: 79 ± 2 % and 100 ± 0; 1,000: 89 ± 2 % and 100 ± 0; unlimited: 99 ± 2 %"
    assert words in judgement.measured
    # no difference is none, at a ceiling too, where the summary says so
    for few, many, verdict, ceiling in (
        (1.0, 1.0, UNDECIDED, ", which leaves little to gain"),
        (0.8, 0.8, UNDECIDED, ""),
        (0.8, 0.6, CONTRARY, ""),
    ):
        completions = {"works@10": few}
        others = [
            replace(
                record,
                result=record.result | {"completion": completions.get(record.trial.variant, many)},
            )
            for record in records
        ]
        judgement = CLAIMS["generalises"].decide(Results(records=others))
        assert judgement.verdict == verdict
        assert judgement.brief.endswith(f"{100 * few:.0f} ± 0 % of new ones{ceiling}")


def test_a_file_that_holds_no_results_is_an_error_with_its_name(tmp_path):
    (tmp_path / "odd.jsonl").write_text('{"score": 1}\n')
    with pytest.raises(ValueError, match=r"odd\.jsonl is no file of trials"):
        read(tmp_path)


def test_every_finding_is_a_claim():
    assert set(CLAIMS) >= FINDINGS


def test_every_verdict_is_one_of_those_that_there_are():
    assert set(verdicts_of(CLAIMS, read())) <= set(VERDICTS)


def test_the_settings_have_every_number_of_the_appendix_and_no_other():
    digits = set("0123456789[")
    cells = {
        name: [row["paper"] for row in settings_table.rows_of(name) if row["paper"][:1] in digits]
        for name in ALGORITHMS
    }
    assert cells == {
        "ppo": ["0.95", "5e-5", "0.95", "0.2", "0.3"],
        "a2c": ["0.95", "1e-4", "0.99", "0.5", "0.01"],
        "rainbow": ["0.95", "5e-4", "0.5", "1.0 to 0.02", "50,000"],
        "sac": ["0.95", "3e-4", "[256, 256]", "[256, 256]", "1,000,000"],
    }


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_the_trainers_have_the_settings_of_the_table(algorithm):
    if algorithm != "ppo":
        pytest.importorskip(
            "tianshou", reason="`make test-research` compares the settings of A2C, Rainbow and SAC"
        )
    for variant in TITLES:
        (logged, *_) = read().trials(algorithm=algorithm, variant=variant, level="random")
        trainer = begin(algorithm, variant, EnvConfig(), seed=0, moves=10_000)
        settings = json.loads(json.dumps(trainer.settings))
        for row in settings_table.rows_of(algorithm):
            if row["fixed"]:
                assert not row["key"]
                continue
            assert settings[row["key"]] == logged.settings[row["key"]], (variant, row["key"])
