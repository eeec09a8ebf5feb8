"""`humanplay reproduce` derives every figure from the bundle alone."""

import hashlib
import json
import shutil
import sqlite3
from contextlib import closing
from functools import partial

import pytest

from humanplay.release import signing
from humanplay.release.build import ReleaseRequest, build_release
from humanplay.release.manifest import MANIFEST, PUBLIC_KEY, SIGNATURE
from marsexplorer import policies
from marsexplorer.policies import find_file
from marsexplorer.policies.files import card
from tests.support.command import command
from tests.support.policy_files import write_network, write_onnx
from tests.support.recorded import alter
from tests.support.stored_studies import freeze, play_study


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    """A release that compares a policy from a file; its database is deleted.

    The policy's file is another one now.
    """
    folder = tmp_path_factory.mktemp("reproduce")
    policy = folder / "mine.onnx"
    shutil.copy(find_file("ppo"), policy)
    study = freeze(folder / "play.db-studies", policies=("random", "frontier-cost", str(policy)))
    play_study(folder / "play.db", study)
    stored_policies = folder / "play.db-studies" / "dunes" / "policies"
    write_network(policy)
    options = {"policy_folder": stored_policies, "with_report": True}
    built = build_release(ReleaseRequest(folder / "play.db", "dunes", folder / "out", **options))
    (folder / "play.db").unlink()
    shutil.rmtree(folder / "play.db-studies")
    return folder / "out", built.signer, policy


@pytest.fixture
def reproduce(capsys, tmp_path, monkeypatch):
    """`reproduce(...)` runs the command in an empty folder: code, stdout, stderr."""
    monkeypatch.setenv("HUMANPLAY_SIGNERS", str(tmp_path / "signers.json"))
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")

    return partial(command, capsys, "reproduce")


def counts(out):
    """{section: (compared, differ)} of the printed table."""
    _, *rows = (line.split("|")[1:-1] for line in out.splitlines() if line.startswith("|"))
    return {
        name.strip(): (int(compared.replace(",", "")), int(differ))
        for name, compared, differ in rows
    }


def test_every_figure_comes_out_again_from_the_bundle_alone(bundle, reproduce):
    out, signer, policy = bundle
    code, output, _ = reproduce(out)
    assert (code, output.strip().splitlines()[-1].split(", ")[1]) == (0, "0 differ")
    sections_compared = counts(output)
    assert all(differ == 0 for _, differ in sections_compared.values())
    sections = ["figures", "metrics", "comparisons", "players", "pictures", "policies", "page"]
    for section in (*sections, "scripts: figures"):
        assert sections_compared[section][0] > 0, section
    assert sections_compared["policies' episodes, replayed"] == (3 * 3 * 2, 0)
    assert sections_compared["policies' episodes, played again"] == (3 * 3, 0)
    assert sections_compared["costs"][0] > 30
    with closing(sqlite3.connect(out / "study.sqlite")) as conn:
        judged = conn.execute(
            "SELECT DISTINCT p.kind FROM move_costs m JOIN series_episodes s USING (episode_id) "
            "JOIN participants p ON p.id = s.participant_id"
        ).fetchall()
        (costs,) = conn.execute("SELECT count(*) FROM move_costs").fetchone()
        (moves,) = conn.execute(
            "SELECT count(*) FROM steps JOIN series_episodes s USING (episode_id) "
            "JOIN participants p ON p.id = s.participant_id "
            "WHERE p.kind = 'human' AND s.phase = 'ranked'"
        ).fetchone()
        (given_up,) = conn.execute(
            "SELECT count(*) FROM episodes JOIN series_episodes s ON s.episode_id = episodes.id "
            "JOIN participants p ON p.id = s.participant_id "
            "WHERE p.kind = 'human' AND s.phase = 'ranked' AND outcome = 'abandoned'"
        ).fetchone()
    assert judged == [("human",)], "nobody asked what a program's moves cost"
    assert sections_compared["cost of each move"][0] == costs == moves + given_up
    assert [path.name for path in (out / "policies").iterdir()] == [
        f"{policies.policy_hash('ppo')}.onnx"
    ]
    assert f"{policy} was not played again" not in output
    assert f"signer not checked: nothing here says whose key {signer} is" in output
    # the sections of the people's report hold as many numbers and texts as report.json does
    again = (
        "policies' episodes, replayed",
        "policies' episodes, played again",
        "cost of each move",
    )
    compared = sum(
        number
        for name, (number, _) in sections_compared.items()
        if not name.startswith("scripts: ") and name not in ("page", *again)
    )
    left_out = len(("made_at", "software_version"))
    assert compared == leaves(json.loads((out / "report.json").read_text())) - left_out


def leaves(value):
    """Count a JSON document's numbers and texts, and the length of each list."""
    if isinstance(value, (dict, list)):
        inner = value.values() if isinstance(value, dict) else value
        return sum(map(leaves, inner)) + isinstance(value, list)
    return 1


@pytest.mark.long
def test_a_policy_whose_file_is_not_in_the_bundle_is_played_again_only_from_the_same_file(
    bundle, tmp_path, reproduce, monkeypatch
):
    out = tmp_path / "without"
    shutil.copytree(bundle[0], out)
    shutil.rmtree(out / "policies")
    code, output, _ = reproduce(out)
    assert (code, counts(output)["policies' episodes, played again"]) == (1, (3 * 3, 0)), (
        "the shipped ppo is that file"
    )
    assert "file policies/" in output
    monkeypatch.setattr(card, "shipped_folder", lambda: tmp_path)
    output = reproduce(out)[1]
    assert counts(output)["policies' episodes, played again"] == (2 * 3, 0)
    replayed = "was not played again, its recorded moves were replayed: the study compares with"
    assert f"{bundle[2]} {replayed}" in output
    ppo = "the study compares with the policy 'ppo'"
    assert f"not compared: cost of moves: {ppo}" in output


@pytest.fixture
def forged(bundle, tmp_path):
    """A copy of the bundle with one changed cell, signed anew by somebody else."""
    out = tmp_path / "forged"
    shutil.copytree(bundle[0], out)
    sql = """UPDATE episodes SET score = score + 0.01 WHERE id = (SELECT e.id FROM episodes e
        JOIN series_episodes s ON s.episode_id = e.id WHERE s.phase = 'ranked'
        AND e.driver = 'human' AND e.outcome = 'explored' LIMIT 1)"""
    assert alter(out / "study.sqlite", sql) == 1
    key = signing.signing_key(tmp_path / "forger.db")
    (out / PUBLIC_KEY).write_bytes(signing.public_pem(key))
    manifest = json.loads((out / MANIFEST).read_text())
    manifest["signer"] = signing.fingerprint((out / PUBLIC_KEY).read_bytes())
    for name in (PUBLIC_KEY, "study.sqlite"):
        manifest["files"][name]["sha256"] = hashlib.sha256((out / name).read_bytes()).hexdigest()
    (out / MANIFEST).write_text(json.dumps(manifest))
    (out / SIGNATURE).write_bytes(key.sign((out / MANIFEST).read_bytes()))
    return out, manifest["signer"]


def test_one_changed_cell_makes_figures_differ_and_the_forgers_key_is_unknown(forged, reproduce):
    out, forger = forged
    code, output, _ = reproduce(out, "--recorded")
    sections = counts(output)
    assert code == 1
    assert sections["figures"][1] > 0
    assert sections["players"][1] > 0
    assert sections["policies"][1] == sections["protocol"][1] == 0
    assert "groups.0.figures.0.score.mean: " in output
    assert "none not as signed" in output
    assert f"signer not checked: nothing here says whose key {forger} is" in output


@pytest.mark.long
def test_a_changed_page_a_changed_report_and_a_changed_move_of_a_policy_are_seen(
    bundle, tmp_path, reproduce
):
    out = tmp_path / "changed"
    shutil.copytree(bundle[0], out)
    page = (out / "report.html").read_text()
    (out / "report.html").write_text(page.replace("95", "96", 1))
    (out / "report-checklist.html").unlink()
    report = json.loads((out / "report.json").read_text())
    report["groups"][0]["figures"][1]["steps"]["mean"] += 1e-6
    (out / "report.json").write_text(json.dumps(report))
    sql = "UPDATE policy_episodes SET actions = substr(actions, 2) WHERE policy = 'random'"
    alter(out / "study.sqlite", sql)
    longer = "UPDATE policy_episodes SET actions = actions || 'N' WHERE policy = 'frontier-cost'"
    alter(out / "study.sqlite", f"{longer} AND terrain_index = 0")
    code, output, _ = reproduce(out, "--recorded")
    sections = counts(output)
    assert code == 1
    assert sections["page"] == (3, 2)
    assert sections["figures"] == (sections["figures"][0], 1)
    assert sections["policies' episodes, replayed"][1] == 4
    assert "file report.html: sha256" in output
    assert "file report-checklist.html" in output


def test_a_policy_that_is_missing_when_a_release_is_made_is_left_out_only_when_asked(
    tmp_path, capsys, reproduce
):
    policy = write_onnx(tmp_path / "gone.onnx", size=(7, 9))
    study = freeze(tmp_path / "play.db-studies", policies=("random", str(policy)))
    play_study(tmp_path / "play.db", study, kinds=("human",))
    policy.unlink()
    study.policy_files.place(str(policy)).unlink()
    database = "--database", tmp_path / "play.db"
    for more, expected in ((), 1), (("--without-policy", policy), 0):
        args = "--study", "dunes", *database, "--out", tmp_path / "out", *more
        code, _, err = command(capsys, "release", *args)
        assert (code, "--without-policy" in err) == (expected, bool(expected))
    assert json.loads((tmp_path / "out" / MANIFEST).read_text())["without_policies"] == [
        str(policy)
    ]
    assert reproduce(tmp_path / "out")[0] == 0
    assert policies.policy_hash("random") is None
