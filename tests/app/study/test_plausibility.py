"""Labels: each on what it is for, and none on plain play."""

from contextlib import closing

from humanplay.db.store import Store
from humanplay.report.statistics.exclusion_sets import members, people_of
from humanplay.study.closing import note_closed
from humanplay.study.data import load
from humanplay.study.folder import Folder
from humanplay.study.plausibility import LABELS, plausibility_labels
from tests.support.study import Person, freeze


def press(at, up=True, kind="keydown", **rest):
    down = {
        "page_load": 0,
        "kind": kind,
        "code": "ArrowUp",
        "repeat": 0,
        "trusted": 1,
        "client_ms": float(at),
        **rest,
    }
    return (
        [down, {**down, "kind": kind.replace("down", "up"), "client_ms": at + 60.0}]
        if up
        else [down]
    )


def presses(times, **rest):
    return [row for at in times for row in press(at, **rest)]


def event(kind, at, page_load=0):
    unknown = dict.fromkeys(("code", "repeat", "trusted"))
    return {**unknown, "kind": kind, "client_ms": float(at), "page_load": page_load}


HUMAN = [
    0,
    310,
    540,
    1200,
    1390,
    1720,
    2400,
    2630,
    3100,
    3290,
    3900,
    4350,
    4600,
    5400,
    5590,
    5900,
    6700,
    6950,
    7200,
    8000,
    8300,
    8900,
]


def test_plain_play_has_no_label():
    assert plausibility_labels([], presses(HUMAN)) == ()
    assert plausibility_labels([], presses(HUMAN, kind="touchdown")) == ()
    assert plausibility_labels([], []) == ()


def test_a_machines_beat_is_robotic_even_with_a_rest_in_it():
    times = [250 * k + (7 if k % 2 else 0) for k in range(24)]
    assert plausibility_labels([], presses(times)) == ("robotic timing",)
    assert plausibility_labels([], presses(times[:12] + [at + 90_000 for at in times[12:]])) == (
        "robotic timing",
    )
    assert plausibility_labels([], presses(times[:20])) == ()  # 19 intervals are too few to tell


def test_keys_that_never_come_up():
    assert plausibility_labels([], presses(HUMAN, up=False)) == ("no key-up",)
    half = [row for number, at in enumerate(HUMAN) for row in press(at, up=number % 2 == 0)]
    assert plausibility_labels([], half) == ()
    assert plausibility_labels([], presses(HUMAN[:4], up=False)) == ()


def test_presses_closer_than_a_person_can_react():
    fast = [*HUMAN[:10], 3300, 3340, *HUMAN[10:]]
    assert plausibility_labels([], presses(fast)) == ()  # two of 23 may happen with two fingers
    faster = sorted(HUMAN + [at + 50 for at in HUMAN[:6]])
    assert plausibility_labels([], presses(faster)) == ("under 80 ms",)


def test_auto_repeat_is_no_press():
    held = presses(HUMAN) + [
        row for at in range(9000, 9900, 33) for row in press(at, up=False, repeat=1)
    ]
    assert plausibility_labels([], held) == ()


def test_a_press_that_the_browser_does_not_vouch_for():
    assert plausibility_labels([], [*presses(HUMAN), *press(9500, trusted=0)]) == ("untrusted",)
    assert plausibility_labels([], [*presses(HUMAN), *press(9500, trusted=None)]) == ()


def test_a_press_in_a_page_that_was_hidden():
    hidden = [*presses(HUMAN), event("hidden", 9100)]
    assert plausibility_labels([], [*hidden, *press(9500)]) == ("unfocused",)
    assert plausibility_labels([], [*hidden, event("visible", 9300), *press(9500)]) == ()


def test_a_press_in_another_load_of_the_page_than_the_hidden_one_has_no_label():
    """After a reload, and in the first tab while a second one is left hidden."""
    hidden = [*presses(HUMAN), event("hidden", 9100)]
    assert (
        plausibility_labels([], [*hidden, event("visible", 50, 1), *press(900, page_load=1)]) == ()
    )
    second = [event("visible", 50, 1), event("hidden", 900, 1)]
    assert plausibility_labels([], [*presses(HUMAN), *second, *press(9500)]) == ()
    assert plausibility_labels([], [*second, *press(950, page_load=1)]) == ("unfocused",)


def test_moves_by_key_without_any_input_event():
    moves = [{"input": "key", "server_ms": 1000 * k} for k in range(6)]
    assert plausibility_labels(moves, []) == ("no telemetry",)
    assert plausibility_labels([{**move, "input": None} for move in moves], []) == ()
    assert plausibility_labels(moves, presses(HUMAN)) == ()


def test_from_one_load_of_the_page_to_another_no_interval_is_counted():
    again = [at / 2 + 17 for at in HUMAN if at % 3]
    assert plausibility_labels([], presses(HUMAN) + presses(again, page_load=1)) == ()
    tabs = [row for at in HUMAN for load in (0, 1) for row in press(at + 5 * load, page_load=load)]
    assert plausibility_labels([], tabs) == ()


def test_an_episode_that_is_abandoned_almost_at_once_was_not_attempted():
    moves = [{"input": None, "server_ms": 1000 * k} for k in range(5)]
    for count, outcome, labels in (
        (0, "abandoned", ("no attempt",)),
        (4, "abandoned", ("no attempt",)),
        (5, "abandoned", ()),
        (1, "collided", ()),
        (1, "environment_failed", ()),
        (0, None, ()),
    ):
        assert plausibility_labels(moves[:count], [], outcome=outcome) == labels, (count, outcome)


def test_whoever_gives_every_terrain_up_at_once_is_labelled_and_in_no_strict_set(server, tmp_path):
    freeze(tmp_path / "playground.db-studies", warm_up=0, ranked=4, questions=())
    person = Person(server)
    person.to_warm_up()
    while person.me()["stage"] == "ranked":
        person.call("next")
        person.call("give-up", {"episode": person.frame["episode"], "step": 0})
    assert person.where["stage"] == "debrief"
    server.stop()
    studies = Folder(tmp_path / "playground.db-studies")
    studies.close("small")
    with closing(Store(tmp_path / "playground.db")) as store:
        note_closed(store, studies.study("small"))
    data = load(tmp_path / "playground.db", "small")
    ranked = [trial.labels for trial in data.trials if trial.phase == "ranked"]
    assert ranked == [("no attempt",)] * 4
    assert members(people_of(data), data.protocol.exclusion["strict"]) == []


def test_several_labels_stand_in_the_order_of_the_list():
    rows = presses([250 * k for k in range(30)], up=False, trusted=0)
    labels = plausibility_labels([], rows)
    assert labels == ("robotic timing", "no key-up", "untrusted")
    assert [name for name in LABELS if name in labels] == list(labels)
