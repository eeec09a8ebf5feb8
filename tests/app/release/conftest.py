"""One released bundle for the tests of this folder, which only read it."""

import pytest

from humanplay.release.build import ReleaseRequest, build_release
from tests.support.stored_studies import StudyRecorder, freeze, play_study


@pytest.fixture(scope="session")
def published(tmp_path_factory):
    """A closed study of three, its database, and its release with its report."""
    folder = tmp_path_factory.mktemp("made")
    study = freeze(folder / "play.db-studies")
    play_study(folder / "play.db", study)
    recorder = StudyRecorder(folder / "play.db", study)
    recorder.join(7, stage="withdrawn", consent=False)
    recorder.close()
    request = ReleaseRequest(
        folder / "play.db", study.name, folder / "out", ("Ada Lovelace",), with_report=True
    )
    return folder, build_release(request)


@pytest.fixture(autouse=True)
def no_known_signers(tmp_path, monkeypatch):
    """Keep the pinned keys of whoever runs the tests out of them."""
    monkeypatch.setenv("HUMANPLAY_SIGNERS", str(tmp_path / "signers.json"))
