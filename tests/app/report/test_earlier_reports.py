"""The report on a stored study holds what earlier code wrote of it (`tests/fixtures/README.md`): what changed is named here."""

import json
from fnmatch import fnmatch

import pytest

from app.cli.main import main
from tests.support import golden

ROUNDING = {"rel": 1e-9, "abs": 1e-12}
"""Sums in another order differ in the last bits."""

CHANGED = {
    "made_at": "the time of the report",
    "software_version": "the software of the report",
    "groups.*.figures.*.bootstrap": "players are drawn in the order of what they played, no longer of their ids",
    "groups.*.metrics.*.iqm_interval": "by the rule, on the players' shares in the middle half, instead of percentiles",
    "groups.*.comparisons.*.new": "players and terrains crossed by the analysis of variance instead of a bootstrap",
    "groups.*.comparisons.*.p_value": "the test has the players in it, and none is made below five players",
    "groups.*.comparisons.*.p_adjusted": "as p_value",
    "groups.*.comparisons.*.ratio_interval": "inverts the test of the difference",
    "groups.*.comparisons.*.normalized_interval": "inverts the test of the difference",
    "groups.*.metrics.*.new_terrains": "as comparisons' new",
    "groups.*.metrics.*.variance": "terrains are shared: crossed instead of one-way",
    "groups.*.cautions.*": "quote the coverage as it was measured last",
    "checklist.*": "sentences, not numbers",
}
"""Where a number of before is computed in another way on purpose, by the path of its leaf, and why. The key stays."""


def leaves(value, path=()):
    """Yield (path, value) for every number and text of a JSON document; the players in the order of their figures."""
    if isinstance(value, dict):
        for key, each in value.items():
            yield from leaves(
                by_figures(each) if key == "players" and isinstance(each, list) else each,
                (*path, key),
            )
    elif isinstance(value, list):
        yield (*path, "number"), len(value)
        for index, each in enumerate(value):
            yield from leaves(each, (*path, str(index)))
    else:
        yield path, value


def by_figures(players):
    """Return the players without their pseudonyms, in the order of their figures: names are of one report alone."""
    return sorted(
        ({**player, "name": None} for player in players),
        key=lambda player: (player["score"], player["steps"]),
    )


def differences(expected, found):
    """Return the leaves of before that are missing or differ without a reason in CHANGED; new ones are no difference."""
    version = expected["software_version"], found["software_version"]
    now = dict(leaves(found))
    return [
        (path, value, now.get(path, "missing"))
        for path, value in leaves(expected)
        if not is_changed(path, now) and not (path in now and same(value, now[path], version))
    ]


def is_changed(path, now):
    """Return whether a leaf may differ: its key, or one above it, is named in CHANGED and is still there."""
    parts = [path[:count] for count in range(1, len(path) + 1)]
    named = [part for part in parts if any(fnmatch(".".join(part), pattern) for pattern in CHANGED)]
    return bool(named) and any(other[: len(named[0])] == named[0] for other in now)


def same(one, other, version):
    if isinstance(one, float) and isinstance(other, float):
        return other == pytest.approx(one, **ROUNDING)
    return other == (one.replace(*version) if isinstance(one, str) else one)


@pytest.mark.parametrize(
    ("name", "options"), [("report.json", ()), ("report-synthetic.json", ("--synthetic",))]
)
def test_the_numbers_of_an_earlier_report_come_out_again(tmp_path, capsys, name, options):
    folder = golden.studies(tmp_path)
    where = ("--database", str(folder / "studies-play.db"), "--studies", str(folder))
    with pytest.raises(SystemExit) as left:
        main(
            [
                "report",
                "--study",
                "dunes",
                "--no-moves",
                *where,
                "--json",
                str(tmp_path / "new.json"),
                *options,
            ]
        )
    assert not left.value.code, capsys.readouterr().err
    expected, found = (
        json.loads(path.read_text()) for path in (folder / name, tmp_path / "new.json")
    )
    assert differences(expected, found) == []
    compared = [
        path
        for path, value in leaves(expected)
        if isinstance(value, float) and not is_changed(path, dict(leaves(found)))
    ]
    assert len(compared) > 500


def test_a_changed_number_a_changed_sentence_and_a_lost_key_are_seen():
    old = {"software_version": "1", "made_at": "now", "score": 0.5, "rule": "t of version 1"}
    assert (
        differences(
            old,
            {
                **old,
                "software_version": "2",
                "made_at": "later",
                "rule": "t of version 2",
                "more": 1,
            },
        )
        == []
    )
    assert differences(old, {**old, "score": 0.5000001})
    assert differences(old, {**old, "rule": "z of version 1"})
    assert differences(old, {key: old[key] for key in ("software_version", "made_at", "score")})
    group = {"groups": [{"comparisons": [{"new": [0.1, 0.2], "mean": 0.5}]}]}
    assert not differences(
        old | group, old | {"groups": [{"comparisons": [{"new": None, "mean": 0.5}]}]}
    )
    assert differences(old | group, old | {"groups": [{"comparisons": [{"mean": 0.5}]}]})
