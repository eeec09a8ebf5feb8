"""What is pushed to the hub is pulled again, against a stand-in of its API."""

import json
import shutil
import socket
import threading

import pytest
import uvicorn
from huggingface_hub import ModelCard
from huggingface_hub import constants as hub_constants

from marsexplorer.policies import load
from marsexplorer.policies.files import hub
from marsexplorer.policies.files.card import read_card, shipped
from tests.support.command import command
from tests.support.hub_server import TOKEN, create_hub
from tests.support.policy_files import write_network
from tests.support.servers import eventually

# Of the hub's own client.
pytestmark = pytest.mark.filterwarnings("ignore:Use 'content=<...>':DeprecationWarning")

REPO = "ada/mars-explorer"


@pytest.fixture
def hub_app(monkeypatch, tmp_path):
    """The stand-in, listening; the client's caches and token are in a test's folder."""
    app = create_hub()
    sock = socket.create_server(("127.0.0.1", 0))
    engine = uvicorn.Server(uvicorn.Config(app, log_level="error", ws="none"))
    thread = threading.Thread(target=engine.run, kwargs={"sockets": [sock]}, daemon=True)
    thread.start()
    eventually(lambda: engine.started)
    monkeypatch.setenv("HF_ENDPOINT", f"http://127.0.0.1:{sock.getsockname()[1]}")
    monkeypatch.setenv("HF_TOKEN", TOKEN)
    for name in ("HF_HUB_CACHE", "HUGGINGFACE_HUB_CACHE", "HF_TOKEN_PATH"):
        monkeypatch.setattr(hub_constants, name, str(tmp_path / name.lower()), raising=False)
    # The stand-in takes files by LFS, as `hf` does without hf_xet.
    monkeypatch.setattr(hub_constants, "HF_HUB_DISABLE_XET", True)
    yield app
    engine.should_exit = True
    thread.join(60)
    sock.close()


def test_a_policy_comes_back_from_the_hub_as_it_went(hub_app, capsys, tmp_path):
    code, printed, complained = command(capsys, "policies", "push", "ppo", REPO, "--private")
    assert code == 0, complained
    assert f"/{REPO}" in printed
    held = hub_app.state.repositories[REPO]
    assert held.private
    assert set(held.commits[-1]) == {"ppo.onnx", "config.json", "README.md"}
    assert len(held.commits) == 2, "one commit after the empty one"
    words = ("policies", "pull", REPO, "--out", str(tmp_path / "pulled"))
    code, printed, complained = command(capsys, *words)
    assert code == 0, complained
    pulled = tmp_path / "pulled" / "ppo.onnx"
    assert pulled.read_bytes() == shipped()["ppo"].read_bytes()
    assert str(pulled) in printed
    assert load(pulled).name == load("ppo").name


def test_a_model_card_has_the_hubs_metadata_and_the_figures_of_the_card():
    model_card = ModelCard(hub.model_card(shipped()["ppo"], REPO))
    card = read_card(shipped()["ppo"])
    assert model_card.data.library_name == "humanplay"
    eval_results = model_card.data.eval_results
    results = {(one.dataset_name, one.metric_type): one.metric_value for one in eval_results}
    for setting, figures in card["results"].items():
        assert results[f"MarsExplorer {setting}", "steps"] == figures["steps"]
    assert card["summary"] in model_card.text
    assert f"marsexplorer policies pull {REPO}" in model_card.text
    assert card["limits"] in model_card.text
    assert max(map(len, model_card.text.splitlines())) < 300  # no list of an entry for each episode
    assert json.loads(hub.card_json(shipped()["ppo"])) == card


def test_a_revision_is_the_policy_as_it_was_then(hub_app, tmp_path):
    older = write_network(tmp_path / "mine.onnx")
    hub.push(older, REPO)
    first = hub_app.state.repositories[REPO].sha()
    before = older.read_bytes()
    shutil.copy(shipped()["ppo"], older)
    hub.push(older, REPO)
    assert hub.pull(REPO, tmp_path / "then", revision=first).read_bytes() == before
    assert hub.pull(REPO, tmp_path / "now").read_bytes() == older.read_bytes() != before


@pytest.mark.parametrize(
    ("words", "sentence", "code"),
    [
        (("push", "frontier-cost", REPO), "frontier-cost is a rule", 2),
        (("push", "nothing.onnx", REPO), "no policy file at nothing.onnx", 2),
        (("push", "ppo", "no-owner"), "expected a repository as OWNER/NAME, got 'no-owner'", 1),
        (("pull", "ada/nothing"), "no repository ada/nothing that you may see", 1),
        (("push", "ppo", REPO, "--token", "hf_of_eve"), "the hub refused", 1),
    ],
)
def test_a_mistake_is_one_sentence_and_leaves_nothing(hub_app, capsys, words, sentence, code):
    ended, _, complained = command(capsys, "policies", *words)
    assert (ended, sentence in complained, len(complained.splitlines())) == (code, True, 1), (
        complained
    )
    assert hub_app.state.repositories == {}


def test_a_repository_without_a_policy_and_a_revision_that_is_not_there(hub_app, tmp_path):
    hub.push(shipped()["ppo"], REPO)
    with pytest.raises(hub.HubError, match="has no such revision"):
        hub.pull(REPO, tmp_path, revision="f" * 40)
    hub_app.state.repositories[REPO].commits.append({"README.md": b"---\n---\n"})
    with pytest.raises(hub.HubError, match=r"expected one \.onnx file"):
        hub.pull(REPO, tmp_path)
    assert list(tmp_path.glob("*.onnx")) == []


def test_a_hub_that_is_not_there_is_said(monkeypatch, tmp_path):
    monkeypatch.setenv("HF_ENDPOINT", "http://127.0.0.1:9")
    with pytest.raises(hub.HubError, match="could not be reached"):
        hub.pull(REPO, tmp_path)
