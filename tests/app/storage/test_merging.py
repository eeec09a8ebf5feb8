"""`merge`: several servers' files as one, or a sentence on why not."""

import json
import shutil
import sqlite3
from contextlib import closing

import pytest

from humanplay.db.merging import MergeError, merge
from humanplay.release.build import ReleaseRequest, build_release
from humanplay.release.bundle import verify_bundle
from humanplay.study.folder import Folder
from humanplay.study.invitations import Invitations, token_of
from humanplay.study.verification import verify_database
from tests.support.command import command
from tests.support.recorded import alter, ask
from tests.support.stored_studies import StudyRecorder, freeze, play_study
from tests.support.study import Person
from tests.support.study import freeze as freeze_small


@pytest.fixture(scope="module")
def servers(tmp_path_factory):
    """One study, played on two servers."""
    folder = tmp_path_factory.mktemp("servers")
    study = freeze(folder / "studies")
    play_study(folder / "a.db", study, ("human", "human"))
    play_study(folder / "b.db", study, ("human", "script"), first=2)
    return folder, study


def test_two_servers_of_one_study_become_one(servers, tmp_path):
    folder, study = servers
    joined, twice = merge([folder / "a.db", folder / "b.db"], tmp_path / "c.db")
    assert (
        joined.added["participants"],
        joined.added["episodes"],
        joined.equal["episodes"],
        twice,
    ) == (4, 24, 0, 0)
    result = verify_database(tmp_path / "c.db")
    assert (result.findings, result.episodes) == ((), 24)
    assert ask(tmp_path / "c.db", "SELECT count(*) FROM meta") == [(0,)]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["c.db"]
    built = build_release(ReleaseRequest(tmp_path / "c.db", study.name, tmp_path / "out"))
    assert built.header.rows["participants"] == 4
    assert verify_bundle(tmp_path / "out").verified.findings == ()


def test_names_of_players_stay_where_they_can_be_changed(servers, tmp_path):
    folder, _ = servers
    with closing(sqlite3.connect(shutil.copy(folder / "a.db", tmp_path / "a.db"))) as conn, conn:
        ((player,), *_) = conn.execute("SELECT id FROM players").fetchall()
        conn.execute("INSERT INTO names VALUES (?, 'Ada', 'ada', 5, 0)", (player,))
    merge([tmp_path / "a.db", folder / "b.db"], tmp_path / "c.db")
    counts = "SELECT count(*) FROM names", "SELECT count(*) FROM meta"
    assert [ask(tmp_path / "c.db", count) for count in counts] == [[(0,)], [(0,)]]


def test_what_both_hold_is_taken_once(servers, tmp_path):
    folder, _ = servers
    merge([folder / "a.db", folder / "b.db"], tmp_path / "c.db")
    joined, _ = merge([tmp_path / "c.db", folder / "b.db"], tmp_path / "d.db")
    assert (joined.added["episodes"], joined.equal["episodes"]) == (24, 12)
    for table in (
        "players",
        "sessions",
        "episodes",
        "steps",
        "participants",
        "identities",
        "input_events",
        "series",
    ):
        assert sorted(ask(tmp_path / "c.db", f"SELECT * FROM {table}")) == sorted(
            ask(tmp_path / "d.db", f"SELECT * FROM {table}")
        )


@pytest.mark.parametrize(
    ("harm", "reason"),
    [
        (
            "UPDATE steps SET client_ms = 1 WHERE step = 1",
            r"the table steps has episode_id .*, step 1 with another content in .*b.db",
        ),
        ("UPDATE participants SET stage = 'ranked'", "the table participants has id"),
        (
            "UPDATE series SET protocol_hash = 'x'",
            "another protocol_hash.*two studies of one name",
        ),
        ("UPDATE series SET secret = '00'", "another secret"),
    ],
)
def test_two_contents_under_one_id_are_refused(servers, tmp_path, harm, reason):
    folder, _ = servers
    shutil.copy(folder / "a.db", tmp_path / "b.db")
    alter(tmp_path / "b.db", harm)
    with pytest.raises(MergeError, match=reason):
        merge([folder / "a.db", tmp_path / "b.db"], tmp_path / "c.db")
    assert not list(tmp_path.glob("*c.db*"))


@pytest.mark.parametrize(
    "harm",
    ["DELETE FROM stage_events WHERE number = 2", "DELETE FROM input_events WHERE number = 1000"],
)
@pytest.mark.parametrize("first", ["a.db", "b.db"])
def test_a_copy_with_fewer_rows_of_somebody_is_refused_on_either_side(
    servers, tmp_path, harm, first
):
    for name in ("a.db", "b.db"):
        shutil.copy(servers[0] / "a.db", tmp_path / name)
    assert alter(tmp_path / "b.db", harm) > 0
    with pytest.raises(MergeError, match="has other rows in"):
        merge([tmp_path / first, tmp_path / ({"a.db", "b.db"} - {first}).pop()], tmp_path / "c.db")


def test_a_release_is_outdated_since_anyone_knew(servers, tmp_path):
    times = {"a.db": None, "b.db": 30, "c.db": 20}
    for name, outdated_ms in times.items():
        shutil.copy(servers[0] / "a.db", tmp_path / name)
        with closing(sqlite3.connect(tmp_path / name)) as conn, conn:
            conn.execute(
                "INSERT INTO releases SELECT name, 1, 'abc', 10, ? FROM series", [outdated_ms]
            )
    for order in ("abc", "cba"):
        merge([tmp_path / f"{name}.db" for name in order], tmp_path / f"{order}.db")
        assert ask(tmp_path / f"{order}.db", "SELECT outdated_ms FROM releases") == [(20,)]


def test_a_study_closed_in_one_is_closed_in_all(tmp_path):
    study = freeze(tmp_path / "studies", close=False)
    play_study(tmp_path / "a.db", study, ("human",))
    from humanplay.study.folder import Folder

    play_study(
        tmp_path / "b.db", Folder(tmp_path / "studies").close(study.name), ("human",), first=1
    )
    merge([tmp_path / "a.db", tmp_path / "b.db"], tmp_path / "c.db")
    ((closed_ms, secret),) = ask(tmp_path / "c.db", "SELECT closed_ms, secret FROM series")
    assert closed_ms
    assert secret == study.secret.hex()
    assert verify_database(tmp_path / "c.db").findings == ()


def test_a_server_may_go_on_writing_and_one_person_on_two_servers_is_reported(
    servers, tmp_path, capsys
):
    folder, study = servers
    recorder = StudyRecorder(tmp_path / "live.db", study)
    recorder.play(recorder.join(0), "warm_up", 0)
    sources = folder / "a.db", tmp_path / "live.db"
    code, output, err = command(capsys, "merge", *sources, "--out", tmp_path / "c.db")
    assert (code, err) == (0, "")
    assert "3 participants and 13 episodes from 2 databases" in output
    assert "1 outside id or invitation took part in a study twice" in output
    recorder.close()


def test_nothing_is_written_over(servers, tmp_path, capsys):
    folder, _ = servers
    (tmp_path / "c.db").write_text("mine")
    sources = folder / "a.db", folder / "b.db"
    code, _, errors = command(capsys, "merge", *sources, "--out", tmp_path / "c.db")
    assert (code, "is there already" in errors) == (1, True)
    assert (tmp_path / "c.db").read_text() == "mine"


def test_a_study_that_is_spread_over_servers_by_its_links_is_put_together(serve, tmp_path, capsys):
    """As deploy.md says: issued once, copied, played, closed, merged, reported."""

    def done(*words):
        """What a command prints that succeeds."""
        code, output, errors = command(capsys, *words)
        assert code == 0, errors
        return output

    labs = [tmp_path / "lab-a.db", tmp_path / "lab-b.db"]
    folders = [Folder(path.with_name(f"{path.name}-studies")) for path in labs]
    study = freeze_small(folders[0].root, recruitment="invitation")
    issued = Invitations(folders[0]).issue("small", 2)
    shutil.copytree(folders[0].root, folders[1].root)
    for path, invitation in zip(labs, issued, strict=True):
        server = serve(database=path)
        person = Person(server, client=server.page(), invitation=token_of(study, invitation.id))
        person.to_warm_up()
        person.play_on()
        server.stop()
    for folder in folders:
        folder.close("small")
    joined = tmp_path / "all.db"
    assert "2 participants and " in done("merge", *labs, "--out", joined)
    shutil.copytree(folders[0].root, tmp_path / "all.db-studies")
    json_report = "--json", tmp_path / "report.json"
    done("report", "--study", "small", "--no-policies", *json_report, "--database", joined)
    (people,) = json.loads((tmp_path / "report.json").read_text())["groups"]
    assert (people["kind"], people["joined"], people["outcomes"]) == ("human", 2, {"explored": 6})
    assert "all as recorded" in done("verify", "--database", joined)
