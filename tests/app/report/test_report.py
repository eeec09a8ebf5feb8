"""The report of data whose figures are known."""

import json
import re
from contextlib import closing
from dataclasses import replace
from importlib import resources

import numpy as np
import pytest

from humanplay.board.sources import Sources
from humanplay.db.reader import Reader
from humanplay.db.series import StudyStore
from humanplay.report.build import build
from humanplay.report.model import SYNTHETIC
from humanplay.report.page import render
from humanplay.report.statistics.formatting import utc
from humanplay.report.statistics.intervals import interval
from humanplay.report.statistics.study_figures import NO_HUMAN_SCORE, live_figure, metric_bounds
from humanplay.report.tables import group_tables
from humanplay.study.data import load
from humanplay.study.folder import Folder
from humanplay.study.invitations import Invitations
from humanplay.study.participation import StudyParticipation
from humanplay.study.protocol import default_protocol
from humanplay.task.registration import environment_of
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode, score
from tests.support.declared import DECLARATIONS
from tests.support.made_studies import CONFIG, FROZEN_MS, person, played, run, study, trial
from tests.support.stored_studies import StudyRecorder, freeze

NAN = float("nan")
ITEMS = [
    *(f"0.{number}" for number in range(1, 11)),
    "1.1", "1.2", "1.2.1", "1.3", "1.4", "1.5", "1.6", "1.7", "1.8", "1.8.1", "1.9", "1.10",
    "2.1", "2.1.1", "2.2", "2.3", "2.3.1", "2.3.2", "2.4", "2.5", "2.6", "2.6.1", "2.6.2", "2.6.2.1", "2.7", "2.7.1",
    "2.7.2", "2.7.2.1", "2.7.3", "2.7.3.1",
    "3.1", "3.1.1", "3.2", "3.2.1", "3.2.2", "3.3", "3.3.1", "3.3.2", "3.4", "3.4.1", "3.5", "3.5.1", "3.6",
    "4.1", "4.1.1", "4.2", "4.2.1", "4.3", "4.4", "4.5", "4.6",
    "5.1.1", "5.1.2", "5.1.3", "5.1.4", "5.1.5", "5.2", "5.2.1", "5.2.2", "5.3", "5.4",
]  # fmt: skip
"""The checklist's numbers in arXiv 2506.13776, appendix B; 5.1 is a heading."""
SCORES = np.array(
    [
        [0.9, 0.8, 0.7, 0.9, 0.95, 0.6],
        [0.95, 0.9, 0.9, 0.85, 0.9, 0.9],
        [0.5, 0.9, 0.4, 0.8, 0.9, 0.7],
    ]
)
HUMAN_TIME = (
    "Geometric mean {} of the {} that succeeded, without pauses and time out of sight; arXiv 2503.14499 (C.1.4) rates tasks "
    "so. Failures are left out, so it is short where many failed."
)
LOWEST = environment_of("mars").bounds(CONFIG)[0]
CLAIM = "Figure of unverified participants (attested)"
"""What the people of an open link are called."""


@pytest.fixture
def data():
    return study(*played(SCORES))


def test_the_figure_is_the_mean_of_player_means_with_the_rules_interval():
    scores = np.vstack([SCORES, SCORES[::-1] - 0.1])
    report = build(study(*played(scores)))
    figure = report.groups[0].figure
    means = scores.mean(1)
    assert (figure.name, figure.players, figure.episodes) == ("per protocol", 6, 36)
    assert figure.score.mean == pytest.approx(means.mean())
    low, high = interval(scores, LOWEST)
    assert figure.score.interval == pytest.approx(
        (float(low), min(float(high), 1))
    )  # no mean score is above 1
    assert f"mean score {means.mean():.3f}" in report.sentence
    assert "6 players, 36 ranked episodes" in report.sentence


def test_completion_is_an_estimate_of_the_same_kind():
    people, trials = played(np.full((6, 6), 0.9))
    failed = (1, 2, 0, 1, 1, 1)
    by = {player.id: number for number, player in enumerate(people)}
    some = [
        replace(episode, outcome="collided")
        if episode.trial < failed[by[episode.participant]]
        else episode
        for episode in trials
    ]
    share = build(study(people, some)).groups[0].figure.completed
    completed = np.array([[trial >= count for trial in range(6)] for count in failed], float)
    low, high = map(float, interval(completed, 0.0))
    assert share.mean == pytest.approx(completed.mean())
    assert share.interval == pytest.approx((max(low, 0), min(high, 1)))


def test_every_figure_of_the_spread_and_of_the_sets_has_its_interval_on_the_page():
    scores = np.random.default_rng(7).normal(0.7, 0.1, (6, 6)).clip(0, 1)
    report = build(study(*played(scores)), [run("ppo", scores.mean(0)), run("random", [0.3] * 6)])
    tables = group_tables(report, report.groups[0])
    cells = [cell for row in tables["variance"].rows for cell in row[1:]]
    cells += [cell for row in tables["exclusion_sets"].rows for cell in row[2:4]]
    cells += [row[at] for row in tables["score"].rows for at in (1, -2)]
    assert len(cells) > 20
    assert [cell for cell in cells if " to " not in cell] == []


def test_steps_count_the_limit_for_an_unfinished_episode():
    people, trials = played(SCORES)
    trials[0] = trial(people[0], 0, 0.2, steps=7, outcome="collided")
    report = build(study(people, trials))
    steps = [CONFIG.limit, *(20 + index for index in range(1, 6))]
    assert report.groups[0].players[0].steps == pytest.approx(np.mean(steps))
    assert report.groups[0].players[0].failed == 1
    assert report.groups[0].outcomes == {"collided": 1, "explored": 17}


def test_a_study_with_scripts_alone_says_that_nobody_has_played():
    report = build(study(*played(SCORES, "script", "noisy-frontier")), [run("ppo", [0.9] * 6)])
    assert report.sentence == NO_HUMAN_SCORE
    assert report.scripts == {"noisy-frontier": 3}
    assert report.groups[0].figures[0].players == 0
    page = render(report)
    assert "3 scripted participants took part (noisy-frontier)" in page
    assert "0.79" not in page.split("Methods")[0]
    assert live_figure(study(*played(SCORES, "script", "random")))["sentence"] == NO_HUMAN_SCORE


def test_scripts_change_nothing_of_the_people(data):
    people, trials = played(SCORES)
    scripts, theirs = played(np.full((5, 6), 0.1), "script", "random", first=50)
    both = build(study([*people, *scripts], [*trials, *theirs]), [run("random", [0.3] * 6)])
    alone = build(data, [run("random", [0.3] * 6)])
    assert both.groups == alone.groups
    assert both.sentence == alone.sentence
    assert live_figure(study([*people, *scripts], [*trials, *theirs])) == live_figure(data)


def test_a_synthetic_report_is_marked_everywhere_and_holds_one_group_a_script():
    people, trials = played(SCORES)
    first, ones = played(SCORES - 0.1, "script", "noisy-frontier", first=20)
    second, others = played(SCORES[:2] - 0.3, "script", "idler", first=40)
    report = build(study([*people, *first, *second], [*trials, *ones, *others]), synthetic=True)
    assert [(group.name, group.kind, group.joined) for group in report.groups] == [
        ("idler", "script", 2),
        ("noisy-frontier", "script", 3),
    ]
    assert report.groups[1].figure.score.mean == pytest.approx((SCORES - 0.1).mean())
    assert report.sentence.startswith("SYNTHETIC")
    document = json.loads(report.to_json())
    assert document["watermark"] == SYNTHETIC
    assert list(document)[:3] == ["format", "watermark", "study"]
    page = render(report)
    assert page.count("SYNTHETIC") > 4  # banner, title, headline, one a figure
    assert page.index('class="synthetic-bar"') < page.index("<main>")
    assert report.checklist == ()
    assert "watermark" not in build(study(people, trials)).to_dict()
    assert "SYNTHETIC" not in render(build(study(people, trials)))


def test_the_cautions_about_simulated_players_call_nobody_a_person():
    scripts, trials = played(SCORES, "script", "idler")
    left = person(30, completed=False, kind="script", script="idler", stage="ranked")
    trials = [*trials, trial(left, 0, 0.5, 20)]
    values = np.array([0.9, 0.9, NAN, NAN, NAN, NAN])
    runs = [run("ppo", values, np.where(np.isnan(values), NAN, 30.0))]
    data = study([*scripts, left], trials, policies=("ppo",))
    (group,) = build(data, runs, synthetic=True).groups
    cautions = " ".join(group.cautions)
    assert "players who began a ranked episode" in cautions
    assert "played by simulated players and by every policy" in cautions
    assert not re.search(r"people|person", cautions)


def test_the_exclusion_sets():
    people, trials = played([*SCORES, [0.8, 0.8, NAN, NAN, NAN, NAN]])
    by = {person.id: index for index, person in enumerate(people)}
    changed = []
    for episode in trials:
        rest = {}
        if by[episode.participant] == 1 and episode.trial == 2:
            rest = {"labels": ("untrusted",)}
        if by[episode.participant] == 2 and episode.trial == 1:
            rest = {"pause_share": 0.6}
        changed.append(
            trial(
                people[by[episode.participant]], episode.trial, episode.score, episode.steps, **rest
            )
        )
    group = build(study(people, changed)).groups[0]
    assert {figure.name: (figure.players, figure.episodes) for figure in group.figures} == {
        "per protocol": (3, 18), "everybody": (4, 24), "strict": (1, 6)
    }  # fmt: skip
    assert group.labels == {"untrusted": 1}
    assert (
        "1 ranked episode of 1 participant carries a label of implausible input."
        in group.deviations
    )
    assert (group.started, group.finished, group.left) == (4, 3, 1)


def test_a_person_with_one_scripted_move_is_a_deviation_and_no_figure():
    people, trials = played(SCORES)
    trials[7] = trial(people[1], 1, 0.9, driver="script")
    group = build(study(people, trials)).groups[0]
    assert (group.everybody.players, group.figure.players) == (3, 2)
    assert (
        "1 ranked episode of 1 participant had a move made by a script: begun by a person, such an "
        "episode counts per protocol as abandoned." in group.deviations
    )


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"config": EnvConfig("random", 7, 9, sensor_radius=4)}, "ran on another configuration"),
        ({"core_version": "0"}, "ran on another core version"),
        ({"outcome": "abandoned"}, "was given up; it counts"),
    ],
)
def test_deviations_of_episodes(change, sentence):
    people, trials = played(SCORES)
    trials[3] = trial(people[0], 3, 0.9, **change)
    assert any(sentence in line for line in build(study(people, trials)).groups[0].deviations)


def test_deviations_of_the_study():
    def deviations_of(*people_and_trials, **rest):
        return " ".join(build(study(*people_and_trials, **rest)).deviations)

    assert deviations_of(*played(SCORES), players=3) == ""
    assert "3 people finished, 4 were planned" in deviations_of(*played(SCORES))
    planned = study(*played(SCORES), players=3)
    from dataclasses import replace

    assert "not the one whose hash was frozen" in " ".join(
        build(replace(planned, protocol_hash="0" * 64)).deviations
    )
    assert "not the one that was committed to" in " ".join(
        build(replace(planned, secret="ab" * 32)).deviations
    )
    assert "joined before the protocol" in " ".join(
        build(replace(planned, frozen_ms=FROZEN_MS + 1500)).deviations
    )


def test_deviations_that_the_server_recorded():
    people, trials = played(SCORES)
    detail = {"sentence": "The page was reloaded 40 times."}
    people[0] = person(0, events=[(FROZEN_MS, "deviation", detail)] * 2)
    deviations = build(study(people, trials)).groups[0].deviations
    assert "The page was reloaded 40 times. (noted 2 times)" in deviations


def test_a_deviation_that_the_server_notes_is_a_sentence(tmp_path):
    """The report prints a sentence, and no raw value, for a script's move."""
    frozen = freeze(tmp_path / "studies")
    with closing(StudyRecorder(tmp_path / "play.db", frozen)) as recorder:
        participant = recorder.join(0)
        recorder.play(participant, "ranked", 0)
        store = StudyStore(recorder.store)
        folder = Folder(tmp_path / "studies")
        who = store.participant(participant)
        participation = StudyParticipation(who, folder, store, Sources(), Invitations(folder))
        participation.note_script("e" * 32)
    with closing(Reader.open(tmp_path / "play.db")) as reader:
        (line, *_) = build(load(reader, frozen.name)).groups[0].deviations[::-1]
    assert re.fullmatch(r"[A-Z][^{}\[\]\"]*\.", line)
    assert "e" * 32 not in line


def test_warm_up_trials_are_shown_and_enter_no_figure():
    people, trials = played(SCORES)
    practice = [
        trial(who, index, 0.1, phase="warm_up", id=f"w{who.id}{index}")
        for who in people
        for index in range(2)
    ]
    with_them, without = (
        build(study(people, episodes, warm_up=2)) for episodes in ([*trials, *practice], trials)
    )
    assert with_them.groups[0].figures == without.groups[0].figures
    assert [row[:2] for row in with_them.groups[0].metric("score").warm_up] == [
        (3, pytest.approx(0.1))
    ] * 2
    assert [row[0] for row in without.groups[0].metric("score").warm_up] == [0, 0]


def test_the_learning_curve_is_of_first_attempts_in_the_order_played():
    people, trials = played(SCORES)
    orders = {who.id: np.random.default_rng(at).permutation(6) for at, who in enumerate(people)}
    trials = [
        replace(episode, trial=int(orders[episode.participant][episode.terrain_index]))
        for episode in trials
    ]
    practice = [
        trial(who, index, 0.1 * index, phase="warm_up", id=f"w{who.id}{index}")
        for who in people
        for index in range(2)
    ]
    report = build(study(people, trials + practice, warm_up=2))
    learning = report.groups[0].metric("score").learning
    for at in range(6):
        at_place = [episode for episode in trials if episode.trial == at]
        earlier = {
            (episode.participant, episode.terrain_index) for episode in trials if episode.trial < at
        }
        assert not earlier & {(episode.participant, episode.terrain_index) for episode in at_place}
        assert learning.by_trial[at][1] == pytest.approx(
            np.mean([episode.score for episode in at_place])
        )
    assert [row[1] for row in report.groups[0].metric("score").warm_up] == pytest.approx([0, 0.1])
    page = render(report)
    assert "First attempts only: nobody meets an instance twice." in page
    assert 'aria-label="Mean score and steps of first attempts by ranked trial' in page


def test_policies_are_compared_on_the_terrains_that_both_played():
    scores = SCORES.copy()
    runs = [
        run("ppo", [0.95] * 5 + [NAN], [25.0] * 5 + [NAN]),
        run("random", [0.3] * 6, [63.0] * 6),
    ]
    report = build(study(*played(scores)), runs)
    ppo = next(
        comparison
        for comparison in report.groups[0].comparisons
        if (comparison.policy, comparison.metric) == ("ppo", "score")
    )
    assert ppo.terrains == 5
    assert ppo.ratio == pytest.approx(0.95 / scores[:, :5].mean())
    assert (ppo.normalized, ppo.normalized_interval) == (None, None), "three players"
    assert (report.policies[0].episodes, report.policies[1].episodes) == (5, 6)
    assert (ppo.p_value, ppo.p_adjusted) == (None, None), "three players"
    assert ppo.interval is None, "three players"


def test_a_policy_is_named_as_code_or_as_this_file_with_the_hash_of_the_protocol():
    digest = "0123456789ab" + "c" * 52
    runs = [run("ppo", [0.95] * 6), run("frontier-cost", [0.9] * 6), run("random", [0.3] * 6)]
    hashes = {"ppo": digest}
    report = build(study(*played(SCORES), policies=("ppo", "random"), policy_hashes=hashes), runs)
    title = "ppo (this file, SHA-256 0123456789ab…)"
    assert [report.title_of(policy.name) for policy in report.policies] == [
        title, "frontier-cost (code)", "random (code)",
    ]  # fmt: skip
    tables = group_tables(report, report.groups[0])
    for name in ("policies", "score", "steps"):
        assert title in [row[0] for row in tables[name].rows], name
    page = render(report)
    assert "is with this file, and says nothing of the algorithm that trained it" in page
    unrecorded = build(study(*played(SCORES)), runs).title_of("ppo")
    assert unrecorded == "ppo (this file, whose SHA-256 was not recorded)"


@pytest.mark.parametrize("primary", ["steps", "score"])
def test_the_policies_of_the_protocol_without_random_are_tested_in_its_primary_metric(primary):
    scores = np.random.default_rng(2).normal(0.7, 0.05, (5, 6))
    runs = [
        run("ppo", scores.mean(0) + 0.05),
        run("frontier-cost", scores.mean(0)),
        run("random", [0.3] * 6),
    ]
    named = {"policies": ("ppo", "frontier-cost", "random"), "primary_metric": primary}
    comparisons = build(study(*played(scores), **named), runs).groups[0].comparisons
    tested = {
        comparison.policy: comparison
        for comparison in comparisons
        if comparison.p_value is not None
    }
    assert set(tested) == {"ppo", "frontier-cost"}
    assert {comparison.metric for comparison in tested.values()} == {primary}
    smaller, larger = sorted(tested.values(), key=lambda comparison: comparison.p_value)
    assert smaller.p_adjusted == pytest.approx(2 * smaller.p_value)
    assert larger.p_adjusted == pytest.approx(max(larger.p_value, smaller.p_adjusted))
    for comparison in tested.values():
        assert (comparison.p_value < 0.05) == (
            not comparison.interval[0] < 0 < comparison.interval[1]
        )


def test_one_player_and_one_terrain_are_reported_without_intervals():
    report = build(study(*played([[0.9]]), ranked=1), [run("random", [0.3])])
    assert "One player gives no interval" in report.sentence
    assert json.loads(report.to_json())["groups"][0]["figures"][1]["score"]["interval"] is None
    page = render(report)
    assert "1 player, 1 ranked episode: mean score 0.900, " in page
    assert "One player gives no interval.</p>" in page
    assert "1 players" not in page


@pytest.mark.parametrize(("terrains", "for_others"), [(4, False), (5, True)])
def test_fewer_than_five_terrains_give_an_interval_for_other_players_alone(terrains, for_others):
    scores = np.random.default_rng(2).normal(0.7, 0.05, (6, terrains))
    runs = [run("ppo", [0.9] * terrains), run("random", [0.3] * terrains)]
    report = build(study(*played(scores), ranked=terrains), runs)
    assert ("95 % interval for other players on these instances " in report.sentence) != for_others
    ends = report.groups[0].figure.score.interval
    assert ends == pytest.approx(tuple(map(float, interval(scores, LOWEST, for_others))), abs=1e-9)
    whom = "other players and other instances" if for_others else "other players on these instances"
    assert f"95 % interval for {whom}; p and p" in " ".join(render(report).split())


def test_page_and_json_have_the_same_intervals_where_players_do_not_differ():
    steps = [[number] * 6 for number in range(29, 34)]
    same = build(study(*played(np.full((5, 6), 0.9), steps=steps)))
    figure = json.loads(same.to_json())["groups"][0]["figures"][0]
    ends = {name: "{:.{}f} to {:.{}f}".format(figure[name]["interval"][0], digits, figure[name]["interval"][1], digits)
            for name, digits in (("score", 3), ("steps", 1))}  # fmt: skip
    began = (
        f"5 players, 30 ranked episodes: mean score 0.900 (95 % interval {ends['score']}), "
        f"31.0 steps to 99 % ({ends['steps']})."
    )
    assert same.sentence == f"{CLAIM}. Per protocol: {began} Everybody who began: {began}"
    low, high = figure["score"]["interval"]
    assert low < 0.9 == pytest.approx(high), "a failure that happened to nobody is possible"


def test_where_everybody_had_the_worst_in_every_episode_there_is_no_interval():
    people, trials = played(np.full((5, 6), LOWEST), steps=np.full((5, 6), CONFIG.limit))
    report = build(study(people, [replace(episode, outcome="collided") for episode in trials]))
    figure = json.loads(report.to_json())["groups"][0]["figures"][0]
    assert (figure["steps"]["mean"], figure["steps"]["interval"]) == (CONFIG.limit, None)
    assert report.sentence.endswith(" Players who do not differ give no interval.")


def test_below_five_shared_terrains_no_policy_is_tested_and_a_caution_says_why():
    scores = np.random.default_rng(3).normal(0.7, 0.05, (6, 6))
    steps = np.random.default_rng(4).normal(40, 5, (6, 6)).round()

    def of(unknown):
        values = np.array([NAN] * unknown + [0.9] * (6 - unknown))
        runs = [run("ppo", values, np.where(np.isnan(values), NAN, 30.0)), run("random", [0.3] * 6)]
        data = study(*played(scores, steps=steps), policies=("ppo", "random"))
        return build(data, runs).groups[0]

    enough, few = of(1), of(2)
    cautions = [caution for caution in few.cautions if "needs 5" in caution]
    assert len(cautions) == 1
    assert cautions[0].startswith("4 instances were played by people and by every policy; ")
    assert not any("needs 5" in caution for caution in enough.cautions)
    (row,) = (
        comparison
        for comparison in enough.comparisons
        if (comparison.policy, comparison.metric) == ("ppo", "steps")
    )
    assert None not in (row.interval, row.everybody_interval, row.p_value, row.p_adjusted)
    for row in few.comparisons:
        figures = (
            row.interval,
            row.everybody_interval,
            row.ratio_interval,
            row.p_value,
            row.p_adjusted,
        )
        assert figures == (None,) * 5


def test_cautions_name_how_few_players_there_are():
    people, trials = played([[0.95] * 6, [0.94] * 6, [0.95] * 6, [0.96] * 6, [0.3] * 6])
    cautions = " ".join(build(study(people, trials, players=10)).groups[0].cautions)
    assert "5 of the 10 players planned" in cautions
    assert "5 players are few" in cautions


def test_the_live_figure_is_the_reports(data):
    live, figure = live_figure(data), build(data).groups[0].figure
    assert (live["set"], live["players"], live["episodes"]) == ("per protocol", 3, 18)
    assert live["everybody"] == {name: live[name] for name in live["everybody"]}
    assert (live["score"]["low"], live["score"]["high"]) == (None, None), "three players"
    assert live["steps"]["mean"] == figure.steps.mean
    nobody = live_figure(study())
    assert (nobody["players"], nobody["score"], nobody["sentence"]) == (0, None, NO_HUMAN_SCORE)


def test_where_nobody_finished_the_live_figure_is_of_everybody():
    data = study(*played([[0.9, 0.8, NAN, NAN, NAN, NAN], [0.7, NAN, NAN, NAN, NAN, NAN]]))
    live = live_figure(data)
    assert (live["set"], live["players"], live["episodes"]) == ("everybody", 2, 12)
    assert build(data).sentence.startswith(
        f"{CLAIM}. Nobody finished as the protocol asks. Everybody who began: 2 players, 12 ranked"
    )


def test_everything_is_json_without_a_number_that_is_none(data):
    document = json.loads(
        build(data, [run("ppo", [0.9] * 6)]).to_json(),
        parse_constant=lambda name: pytest.fail(name),
    )
    assert document["format"] == "humanplay-report-1"
    assert document["groups"][0]["figures"][1]["score"]["mean"] == pytest.approx(SCORES.mean())
    assert document["estimand"]


def test_the_worst_and_the_best_episode_lie_within_the_bounds():
    config = EnvConfig("random", 7, 9, sensor_radius=3)
    low, high = metric_bounds(environment_of("mars"), config, "score")
    episode = Episode.begin(config, terrain=np.zeros((7, 9), bool))
    for move in range(config.limit - 1):
        if not episode.ended:
            episode.step(1 if move % 2 == 0 else 3)
    if not episode.ended:
        episode.step(0)  # off the grid, after as many fruitless moves as there are
    assert low <= episode.score < 0.1
    assert high == 1
    assert metric_bounds(environment_of("mars"), config, "steps") == (1, config.limit)


def test_no_item_of_the_checklist_is_answered_yes_but_by_the_study():
    text = resources.files("humanplay.report").joinpath("checklist.txt").read_text()
    rows = [line.split("|") for line in text.splitlines() if line and not line.startswith("#")]
    assert len(rows) == len(ITEMS)
    assert [row[0].strip() for row in rows if row[3].strip() == "Yes"] == []


def test_the_checklist_is_filled_and_says_what_is_missing(data):
    items = {item.number: item for item in build(data, [run("ppo", [0.9] * 6)]).checklist}
    assert items["1.1"].answer == "3"
    assert items["1.3"].answer == "3.0"
    assert items["1.9"].source == "protocol"
    compared = {number: items[number].answer for number in ("4.1", "4.3", "4.4", "4.5")}
    assert set(compared.values()) == {"Yes"}
    assert (items["4.2"].answer, items["5.1.3"].answer) == ("No", "Yes"), "of three players"
    assert items["5.1.3"].detail == HUMAN_TIME.format("30.0 seconds", "18 of 18 ranked episodes")
    assert [number for number in items if number.startswith("3.")][:3] == ["3.1", "3.1.1", "3.2"]
    assert list(items) == ITEMS
    assert {item.source for item in items.values()} == {
        "database",
        "protocol",
        "software",
        "missing",
    }
    assert {number for number, item in items.items() if item.answer == "Missing"} == {
        *("0.1", "0.2", "0.3", "0.4"), "1.8"
    }  # fmt: skip
    assert items["2.3.2"].answer == "0 of 3", "nobody was turned away before they agreed"
    declared = {item.detail for item in items.values() if item.answer == "Declared"}
    for text in DECLARATIONS.values():
        assert any(text in answer for answer in declared), text
    assert items["2.5"].answer == "Unknown"
    assert items["3.2.2"].answer == "0 of 3"
    assert items["1.8"].source == "missing"
    assert (
        items["4.1"].answer != {item.number: item for item in build(data).checklist}["4.1"].answer
    )


def test_an_interval_on_fixed_instances_is_for_these_alone_and_a_missing_one_says_why():
    def item(scores, number, **protocol):
        report = build(study(*played(scores), **protocol))
        return {item.number: item for item in report.checklist}[number]

    many = np.vstack([SCORES, SCORES[::-1] - 0.1])
    assert item(many, "4.2").detail == "Of the means, for other players and other instances."
    fixed = item(many, "4.2", fixed_terrains=True)
    assert (fixed.answer, fixed.detail) == (
        "Yes",
        "Of the means, for other players on these instances.",
    )
    assert item(SCORES, "4.2").detail == "Fewer than 5 players give no interval."
    assert item(SCORES, "2.6.1", warm_up=0).answer == "Tutorial"


def test_what_is_known_of_terrains_told_to_others_is_said_without_a_verdict(data):
    report = build(data)
    item = next(item for item in report.checklist if item.number == "2.5")
    begun = [trial.started_ms for trial in data.trials]
    ended = [trial.ended_ms for trial in data.trials]
    dates = f"the first began {utc(min(begun))}, the last ended {utc(max(ended))}"
    sentence = (
        "Everybody met the same 6 ranked instances, in orders that follow from the study's secret; "
        f"{dates}. Whether anybody told others of an instance is not known."
    )
    assert item.answer == "Unknown"
    assert sentence in item.detail
    page = render(report)
    assert sentence.replace("'", "&#39;") in page
    assert "leak" not in page
    nobody = build(study((), ()))
    assert (
        "Nobody has begun a ranked episode."
        in {i.number: i for i in nobody.checklist}["2.5"].detail
    )
    one = build(study(*played(SCORES[:, :1]), ranked=1))
    assert (
        "Everybody met the same ranked instance; "
        in {i.number: i for i in one.checklist}["2.5"].detail
    )


def test_the_checklist_says_what_is_true_of_arms_too():
    arms = [{"name": "plain"}, {"name": "hinted", "hint": "Walls first"}]
    for protocol in ({}, {"arms": arms}):
        items = {item.number: item for item in build(study(**protocol)).checklist}
        language = items["0.7"].answer, items["0.7"].detail
        assert language == ("en", "Everybody reads the study in this language.")


def test_human_time_is_that_of_successes_without_nights():
    people, trials = played(SCORES)
    night = replace(trials[0], ended_ms=trials[0].started_ms + 43_200_000, active_ms=4_000.0)
    failed = [replace(episode, outcome="collided", active_ms=1.0) for episode in trials[2:]]
    of = [night, replace(trials[1], active_ms=9_000.0), *failed]

    def time(trials):
        items = {item.number: item for item in build(study(people, trials)).checklist}
        return items["5.1.3"].detail

    assert time(of) == HUMAN_TIME.format("6.0 seconds", "2 of 18 ranked episodes")
    hours = [replace(episode, active_ms=7_200_000.0) for episode in trials]
    assert time(hours) == HUMAN_TIME.format("120.0 minutes", "18 of 18 ranked episodes")
    assert time(failed) == "No ranked episode succeeded."


def test_the_checklist_counts_who_is_left_out_and_names_how_people_came():
    people, trials = played([*SCORES, [0.8, 0.8, NAN, NAN, NAN, NAN]])
    assumed = {
        "assumed_mean": 30.0,
        "assumed_player_sd": 8.0,
        "assumed_terrain_sd": 5.0,
        "assumed_episode_sd": 15.0,
    }
    power = {"policy_better": 0.81, "people_better": 0.72, "half_width": 6.0, "studies": 10_000}
    fields = {
        "recruitment": "panel",
        "outside_ids": ("PROLIFIC_PID",),
        "players": 10,
        **assumed,
        "policy_difference": 9.0,
        "power": power,
    }
    items = {item.number: item for item in build(study(people, trials, **fields)).checklist}
    assert items["3.2.2"].answer == "1 of 4"
    assert "Of 20 finished ranked episodes 0 carry a label" in items["3.2.2"].detail
    assert "panel" in items["2.2"].detail
    assert (items["1.8"].answer, items["1.8"].source) == ("Yes", "protocol")
    assert "seen in 81 % of studies, one that is worse by as much in 72 %" in items["1.8"].detail
    unplanned = build(study(people, trials)).checklist
    assert {item.number: item for item in unplanned}["1.8"].source == "missing"


@pytest.mark.parametrize(
    ("level", "recruitment", "claim"),
    [
        ("supervised", "open", "Human level (supervised)"),
        ("attested", "invitation", "Human level (attested)"),
        ("attested", "panel", "Figure of unverified participants (attested)"),
        ("attested", "signed panel", "Human level (attested)"),
        ("attested", "open", "Figure of unverified participants (attested)"),
        ("unattested", "invitation", "Figure of unverified participants (unattested)"),
    ],
)
def test_a_figure_is_called_the_human_level_only_where_people_are_known_to_be_people(
    level, recruitment, claim
):
    people, trials = played(SCORES)
    trials = [replace(episode, attestation="supervised") for episode in trials]
    links = "signed" if recruitment == "signed panel" else "unsigned"
    came = recruitment.removeprefix("signed ")
    rest = {"required_attestation": level, "recruitment": came, "panel_links": links}
    supervised = study(people, trials, outside_ids=("ID",), **rest)
    assert build(supervised).sentence.startswith(f"{claim}. Per protocol: 3 players")
    assert live_figure(supervised)["claim"] == claim
    page = render(build(supervised))
    assert f"{claim}. Per protocol: 3 players" in page
    assert ("ids anybody may make up" in page) == (recruitment == "panel")


def test_the_report_counts_what_the_required_level_leaves_out():
    people, trials = played(SCORES)
    trials[0] = replace(
        trials[0], attestation="unattested", attestation_reason="step 3: no press of its own"
    )
    trials[1] = replace(
        trials[1], attestation="unattested", attestation_reason="step 12: no press of its own"
    )
    trials[7] = replace(trials[7], attestation="supervised")
    trials[17] = replace(trials[17], attestation="spoilt", attestation_reason="step 4: as above")
    report = build(study(people, trials, required_attestation="attested"))
    group = report.groups[0]
    assert group.attestation.episodes == {
        "unattested": 2,
        "spoilt": 1,
        "attested": 14,
        "supervised": 1,
    }
    assert group.attestation.people == {
        "unattested": 1,
        "spoilt": 1,
        "attested": 3,
        "supervised": 1,
    }
    assert (group.attestation.left_out, group.attestation.people_left_out) == (2, 1)
    assert group.attestation.reasons == {"no press of its own": 2, "as above": 1}
    assert (group.figure.players, group.everybody.players) == (2, 3)
    assert [row.status for row in group.statuses] == ["finished", "not_attested"]
    assert group.figure.completed.mean == pytest.approx(11 / 12), (
        "per protocol what is spoilt counts as given up"
    )
    assert group.everybody.completed.mean == 1, "nothing shows a program"
    page = render(report)
    assert "The level required left out 2 ranked episodes of 1 person" in page
    assert "by a link that anybody could open" in page
    assert "ended all, but not all attested: 1" in page
    scripts = build(study(*played(SCORES, "script", "idler")), synthetic=True)
    assert scripts.groups[0].attestation is None


def test_the_worst_score_of_a_small_building_lies_within_the_bounds():
    config = EnvConfig.of("building", (7, 9), sensor_radius=3)
    terrain = np.ones((7, 9), bool)
    terrain[0, :2] = False  # two cells are free, and what can be seen from them is all that counts
    episode = Episode.begin(config, terrain=terrain)
    for _ in range(config.limit):
        if not episode.ended:
            episode.step(0)
    low, _ = metric_bounds(environment_of("mars"), config, "score")
    worst = score(config, -config.r_invalid - 0.5 * (config.limit - 1), episode.cells)
    assert (
        low
        <= worst
        < metric_bounds(environment_of("mars"), EnvConfig.of("random", (7, 9)), "score")[0]
    )


def test_no_answer_of_the_checklist_is_another_environments():
    config = environment_of("gymnasium:FrozenLake-v1").default
    lake = default_protocol("lake", config, "gymnasium:FrozenLake-v1", policies=("random",))
    data = replace(study((), ()), protocol=lake)
    for item in build(data).checklist:
        assert not re.search(r"explor|discover|matrix|MarsExplorer(?! Playground)", item.detail), (
            item
        )
