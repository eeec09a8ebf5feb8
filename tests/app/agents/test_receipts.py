"""A card's signed receipt, checked alone and by replaying it with the opening."""

import json
import math
import shutil
from contextlib import closing
from pathlib import Path

import pytest

from humanplay.agents.receipts import OPENING_FORMAT, chain_hash, read_signed, sign
from humanplay.release import signing
from humanplay.study.data import load
from humanplay.study.verification import verify_database
from tests.support.agents import begun, closed_evaluation, paths
from tests.support.command import command, run
from tests.support.stored_studies import StudyRecorder, freeze


@pytest.fixture(scope="module")
def closed(tmp_path_factory, shipped_policies):
    return closed_evaluation(tmp_path_factory.mktemp("evaluation"), shipped_policies)


def receipts_of(root):
    """The receipts by author and number."""
    receipts = {}
    for path in (root / "playground.db-agents/agents/receipts").iterdir():
        content = json.loads(path.read_text())
        receipts[content["card"]["author"], content["card"]["number"]] = path
    return receipts


@pytest.fixture
def files(closed, tmp_path):
    """A copy of Ann's first receipt, and of the opening."""
    receipt = tmp_path / "receipt.json"
    shutil.copy(receipts_of(closed)["Ann", 1], receipt)
    return receipt, closed / "playground.db-agents/agents/opening.json"


def verify(capsys, receipt, *more):
    return command(capsys, "agents", "verify", receipt, *more)


def changed(receipt, change):
    """Change a receipt's content and write it."""
    content = json.loads(Path(receipt).read_text())
    change(content)
    Path(receipt).write_text(json.dumps(content))
    return content


def test_a_receipt_is_checked_alone_and_by_the_opening(files, closed, capsys):
    receipt, opening = files
    code, output, _ = verify(capsys, receipt)
    assert (code, "nothing wrong; no episode simulated" in output) == (0, True)
    content = json.loads(receipt.read_text())
    fingerprint = signing.fingerprint(content["public_key"].encode())
    card = content["card"]["id"]
    code, output, _ = verify(
        capsys, receipt, "--opening", opening, "--key", fingerprint, "--card", card
    )
    assert (code, "every episode simulated again" in output, "signer checked" in output) == (
        0,
        True,
        True,
    )
    assert content["agent"] == {"agent": "Mapper", "model": "rule", "prompts_sha256": "0" * 64}
    assert content["seen_by"]["participants"] == 3
    assert "who could have seen the instances before: 3 participants (since 2026-09" in output
    assert content["seen_by"]["participants_since"].startswith("2026-09")
    assert verify(capsys, receipt, "--key", "0" * 64)[0] == 1


def test_what_was_left_or_never_begun_counts_as_abandoned(closed, capsys):
    path = receipts_of(closed)["Bo", 1]
    content = json.loads(path.read_text())
    came = {episode["index"]: episode for episode in content["episodes"]}
    assert [came[i]["outcome"] for i in range(3)] == ["abandoned", "explored", "abandoned"]
    assert [came[i]["begun"] for i in range(3)] == [False, True, True]
    assert came[0]["score"] <= came[2]["score"] < came[1]["score"]
    assert (
        verify(capsys, path, "--opening", closed / "playground.db-agents/agents/opening.json")[0]
        == 0
    )


def test_a_further_card_of_an_author_says_what_it_has_seen_and_does_not_rank(closed, capsys):
    path = receipts_of(closed)["ann", 2]
    content = json.loads(path.read_text())
    assert content["card"]["ranks"] is False
    assert (
        content["card"]["note"]
        == "card 2 of this author: it has seen these instances, and does not rank"
    )
    assert content["seen_by"]["other_cards_before"] == 1
    assert "has seen these instances" in verify(capsys, path)[1]

    def ranks(content):
        content["card"].update(ranks=True, note=None)

    key = signing.signing_key(closed / "playground.db")
    forged = dict(content)
    ranks(forged)
    forged.pop("public_key"), forged.pop("signature")
    path = path.with_name("forged.json")
    path.write_text(json.dumps(sign(forged, key)))
    try:
        code, output, _ = verify(capsys, path)
        assert (code, "ranks" in output) == (1, True)
    finally:
        path.unlink()


@pytest.mark.parametrize(
    "change",
    [
        lambda content: content["episodes"][0].update(score=1.0),
        lambda content: content["agent"].update(agent="Another"),
        lambda content: content["seen_by"].update(participants=0),
        lambda content: content.update(sees="picture"),
        lambda content: content["episodes"].pop(),
    ],
    ids=["score", "agent", "seen by", "sees", "an episode less"],
)
def test_a_changed_receipt_is_found(files, capsys, change):
    receipt, _ = files
    changed(receipt, change)
    code, output, _ = verify(capsys, receipt)
    assert (code, "its signature is invalid" in output) == (1, True)


def test_a_receipt_signed_anew_is_found_by_its_key_and_by_the_simulation(
    files, closed, tmp_path, capsys
):
    receipt, opening = files

    def better(content):
        content["episodes"][0]["score"] = 1.0
        start = f"{content['protocol_hash']}|{content['card']['id']}"
        content["chain"] = chain_hash(start, content["episodes"])

    content = changed(receipt, better)
    del content["public_key"], content["signature"]
    own_key = signing.signing_key(tmp_path / "own.db")
    receipt.write_text(json.dumps(sign(content, own_key)))
    assert verify(capsys, receipt)[0] == 0  # by itself it is sound: somebody else's
    code, output, _ = verify(capsys, receipt, "--opening", opening)
    assert (code, "public_key" in output) == (1, True)
    servers = signing.signing_key(closed / "playground.db")
    receipt.write_text(json.dumps(sign(content, servers)))
    code, output, _ = verify(capsys, receipt, "--opening", opening)
    assert (code, "chain" in output, "instance" in output) == (1, True, True)


def test_a_receipt_presented_for_another_card_or_series_is_refused(files, closed, tmp_path, capsys):
    receipt, opening = files
    other = json.loads(receipts_of(closed)["Bo", 1].read_text())["card"]["id"]
    code, output, _ = verify(capsys, receipt, "--card", other)
    assert (code, "card" in output) == (1, True)
    assert verify(capsys, receipt, "--evaluation", "another")[0] == 1
    assert verify(capsys, receipt, "--evaluation", "agents")[0] == 0
    content = json.loads(opening.read_text())
    del content["public_key"], content["signature"]
    content["evaluation"] = "another"
    renamed = tmp_path / "opening.json"
    key = signing.signing_key(closed / "playground.db")
    renamed.write_text(json.dumps(sign(content, key)))
    assert verify(capsys, receipt, "--opening", renamed)[0] == 1
    content["evaluation"], content["secret"] = "agents", "00" * 32
    renamed.write_text(json.dumps(sign(content, key)))
    code, output, _ = verify(capsys, receipt, "--opening", renamed)
    assert (code, "commitment" in output) == (1, True)


def test_a_file_that_is_no_receipt_is_refused(tmp_path, capsys, files):
    (tmp_path / "none.json").write_text("[]")
    for lacking in ("card", "episodes", "agent", "chain"):
        content = json.loads(files[0].read_text())
        del content[lacking]
        (tmp_path / "lacking.json").write_text(json.dumps(content))
        assert verify(capsys, tmp_path / "lacking.json", "--opening", files[1])[0] == 1
    key = signing.signing_key(tmp_path / "own.db")
    content = json.loads(files[0].read_text())
    del content["public_key"], content["signature"], content["seen_by"]
    (tmp_path / "lacking.json").write_text(json.dumps(sign(content, key)))
    code, output, _ = verify(capsys, tmp_path / "lacking.json")
    assert (code, "KeyError('seen_by')" in output) == (1, True)
    changed(files[0], lambda content: content["episodes"][0].update(score=math.nan))
    code, output, _ = verify(capsys, files[0], "--opening", files[1])
    assert (code, "its signature is invalid" in output, "damaged" in output) == (1, True, True)
    code, _, errors = verify(capsys, tmp_path / "none.json")
    assert (code, "is no file of format humanplay-receipt-1" in errors) == (1, True)
    assert verify(capsys, files[1])[0] == 1


def test_receipts_are_the_same_bytes_when_they_are_written_again(closed, capsys):
    before = {path: path.read_bytes() for path in receipts_of(closed).values()}
    assert command(capsys, "agents", "close", "agents", "--yes", *paths(closed))[0] == 0
    assert {path: path.read_bytes() for path in receipts_of(closed).values()} == before
    assert read_signed(closed / "playground.db-agents/agents/opening.json", OPENING_FORMAT)


def test_the_files_are_written_again_without_a_card_that_was_erased(closed, tmp_path, capsys):
    root = shutil.copytree(closed, tmp_path / "copy")
    mine, bos = receipts_of(root)["Ann", 1], receipts_of(root)["Bo", 1]
    before = mine.read_bytes()
    forget = "agents", "forget", "agents", bos.stem, "--yes", *paths(root)
    assert command(capsys, *forget)[0] == 0
    assert command(capsys, "agents", "close", "agents", *paths(root))[0] == 0
    assert (mine.read_bytes() == before, bos.exists()) == (True, False)
    opening = root / "playground.db-agents/agents/opening.json"
    assert bos.stem not in opening.read_text() + (opening.parent / "comparison.json").read_text()
    assert verify(capsys, mine, "--opening", opening)[0] == 0


def comparison_of(root):
    return json.loads((root / "playground.db-agents/agents/comparison.json").read_text())


def test_agents_policies_and_people_stand_on_one_scale(closed):
    comparison = comparison_of(closed)
    rows = {(row["kind"], row["name"]): row for row in comparison["rows"]}
    agents = [row for row in comparison["rows"] if row["kind"] == "agent"]
    mapper, knower, left = sorted(
        agents, key=lambda row: (row["card"]["author"].lower(), row["card"]["number"])
    )[:3]
    assert comparison["people"]["players"] == 2
    assert ("policy", "random") in rows
    assert knower["score"]["mean"] > mapper["score"]["mean"] > left["score"]["mean"]
    assert (mapper["rank"], knower["rank"], left["rank"]) == (1, None, 2)
    assert (mapper["attempts"], left["attempts"]) == (3, 2)
    assert left["outcomes"][0] == "abandoned"
    both = next(instance for instance in comparison["instances"] if instance["completed"] == 2)
    assert both["players"] == 2
    assert 0 < both["best"] <= both["upper_median"] <= comparison["limit"]
    difference = mapper["score"]["mean"] - comparison["people"]["score"]["mean"]
    assert mapper["score"]["difference"] == pytest.approx(difference)


@pytest.mark.parametrize("finishers", [0, 1])
def test_the_comparison_tells_of_each_instance_what_came_of_everybody_who_ended_it(
    serve, tmp_path, finishers
):
    study = freeze(tmp_path / "playground.db-studies", close=False)
    with closing(StudyRecorder(tmp_path / "playground.db", study)) as recorder:
        recorder.play(recorder.join(0, stage="ranked"), "ranked", 0, "crash")
        for number in range(1, 1 + finishers):
            done = recorder.join(number)
            for trial in range(3):
                recorder.play(done, "ranked", trial)
    assert run("study", "close", "dunes", "--keep-secret", "--yes", *paths(tmp_path)) == 0
    begun(tmp_path / "playground.db", of="dunes")
    assert run("agents", "close", "agents", "--yes", "--now", *paths(tmp_path)) == 0
    data = load(tmp_path / "playground.db", "dunes")
    for instance in comparison_of(tmp_path)["instances"]:
        trials = [t for t in data.trials if t.terrain_index == instance["index"]]
        scores = [trial.score for trial in trials]
        assert instance["players"] == len(trials)
        assert instance["score"] == (pytest.approx(sum(scores) / len(trials)) if trials else None)
    page = serve().client().get("/evaluations/agents")
    assert page.status_code == 200
    assert "Closed" in page.text


def test_a_bundle_of_the_study_holds_no_receipts(closed, tmp_path, capsys):
    bundle = tmp_path / "dunes-1"
    code, _, errors = command(
        capsys, "release", "--study", "dunes", "--out", bundle, *paths(closed)
    )
    assert code == 0, errors
    names = [str(path.relative_to(bundle)) for path in bundle.rglob("*")]
    assert not [name for name in names if "receipt" in name or "evaluation" in name]
    assert command(capsys, "reproduce", bundle, "--recorded")[0] == 0


def test_the_database_verifies_with_its_evaluations(closed):
    assert verify_database(closed / "playground.db").findings == ()
