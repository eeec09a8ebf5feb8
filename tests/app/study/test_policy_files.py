"""A frozen study is measured with the policy files of its time."""

import hashlib
import shutil

import pytest

from humanplay.results.entries import LeaderboardEntry
from humanplay.study.debrief import _play
from humanplay.study.folder import Folder
from humanplay.study.policy_episodes import play_policies
from humanplay.study.protocol import StudyError, default_protocol
from humanplay.study.verification import check_policy_files
from humanplay.task import PolicyError
from humanplay.task.registration import environment_of
from marsexplorer.config import EnvConfig
from marsexplorer.policies import find_file
from marsexplorer.policies.files import card
from tests.support.declared import DECLARATIONS
from tests.support.policy_files import write_network, write_onnx

CONFIG = EnvConfig("random", 6, 7, sensor_radius=3)
SEEDS = {0: 4, 1: 5}


def sha256(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture
def mine(tmp_path):
    """A policy's file, a model of another maker."""
    return write_onnx(tmp_path / "mine.onnx", seed=1)


@pytest.fixture
def study(tmp_path, mine):
    """An open study that compares with that file."""
    folder = Folder(tmp_path / "playground.db-studies")
    fields = {
        "warm_up": 1,
        "ranked": 2,
        "players": 2,
        "policies": (str(mine), "frontier-cost"),
        "debrief_policy": str(mine),
        "declarations": DECLARATIONS,
    }
    folder.create(default_protocol("dunes", CONFIG, **fields))
    return folder.freeze("dunes")


def moves(study, mine, files=None):
    return [
        (episode.policy_hash, episode.actions)
        for episode in play_policies(
            [str(mine)], environment_of("mars"), CONFIG, SEEDS, files=files
        )
    ]


def test_freezing_records_every_file_and_keeps_it(study, mine, tmp_path):
    ppo = find_file("ppo")  # the policy that costs are relative to
    assert study.protocol.policy_hashes == {str(mine): sha256(mine), "ppo": sha256(ppo)}
    copy = tmp_path / "playground.db-studies" / "dunes" / "policies"
    assert {path.name: path.read_bytes() for path in copy.iterdir()} == {
        f"{sha256(mine)}.onnx": mine.read_bytes(), f"{sha256(ppo)}.onnx": ppo.read_bytes()
    }  # fmt: skip


def test_a_frozen_study_plays_its_own_file_when_the_path_holds_another_one_or_none(study, mine):
    before = moves(study, mine, study.policy_files)
    assert before == moves(study, mine)
    write_onnx(mine, seed=2)
    assert moves(study, mine) != before, "the new file must play another way for this test"
    assert moves(study, mine, study.policy_files) == before
    mine.unlink()
    assert moves(study, mine, study.policy_files) == before
    assert [len(run.actions) for run in _play(study, "warm_up")], "the debrief goes on, too"
    entry = LeaderboardEntry(
        "d", "d", CONFIG, None, None, (4, 5), "dunes", (str(mine),), study.policy_files
    )
    job = entry.evaluations({})[str(mine)]
    assert job.policy == str(study.policy_files.place(str(mine)))


def test_a_lost_file_is_said_and_no_other_one_plays(study, mine, tmp_path):
    write_onnx(mine, seed=2)
    copy = study.policy_files.place(str(mine))
    copy.unlink()
    with pytest.raises(PolicyError, match=f"and that file is not here.* to {copy}"):
        moves(study, mine, study.policy_files)
    assert _play(study, "warm_up") == []
    copy.write_bytes(mine.read_bytes())
    with pytest.raises(PolicyError, match="no other one is played in its place"):
        moves(study, mine, study.policy_files)


def test_verify_names_a_kept_file_that_is_lost_or_changed(study, mine, tmp_path):
    folder = Folder(tmp_path / "playground.db-studies")
    assert list(check_policy_files(folder, ["dunes"])) == []
    copy = study.policy_files.place(str(mine))
    copy.write_bytes(b"another one")
    (finding,) = check_policy_files(folder, ["dunes"])
    assert (finding.where, finding.found) == (
        f"file {copy}",
        hashlib.sha256(b"another one").hexdigest(),
    )
    copy.unlink()
    (finding,) = check_policy_files(folder, ["dunes"])
    assert finding.found == "no such file"


def test_a_hash_in_the_draft_must_be_that_of_the_file(tmp_path, mine):
    folder = Folder(tmp_path / "playground.db-studies")
    fields = {"policies": (str(mine),), "debrief_policy": "random", "declarations": DECLARATIONS}
    path = folder.create(
        default_protocol("right", CONFIG, policy_hashes={str(mine): sha256(mine)}, **fields)
    )
    assert folder.freeze("right").protocol.policy_hashes[str(mine)] == sha256(mine)
    folder.create(default_protocol("wrong", CONFIG, policy_hashes={str(mine): "0" * 64}, **fields))
    with pytest.raises(StudyError, match=f"the SHA-256 {'0' * 64}, its file has {sha256(mine)}"):
        folder.freeze("wrong")
    assert sha256(mine) in path.read_text()


@pytest.fixture
def later_version(tmp_path, monkeypatch):
    """The shipped policies of a later version.

    `ppo` is another network there, and today's has another name.
    """
    shipped = tmp_path / "shipped"
    shipped.mkdir()
    shutil.copy(find_file("ppo"), shipped / "ppo-first.onnx")
    write_network(shipped / "ppo.onnx")
    monkeypatch.setattr(card, "shipped_folder", lambda: shipped)
    return shipped


def test_a_shipped_file_is_found_by_its_hash_whatever_its_name_is_now(
    study, later_version, tmp_path
):
    files = study.policy_files.at(tmp_path / "playground.db-studies" / "none" / "policies")
    assert files.source("ppo") == str(later_version / "ppo-first.onnx")
    assert files.source("frontier-cost") == "frontier-cost"
    (later_version / "ppo-first.onnx").unlink()
    with pytest.raises(PolicyError, match="'ppo' of SHA-256"):
        files.source("ppo")
    copy = study.policy_files.place("ppo")
    assert study.policy_files.source("ppo") == str(copy), "it keeps its own"
