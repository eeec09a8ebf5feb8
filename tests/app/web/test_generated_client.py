"""A client from somebody else's generator plays an episode.

`make client` installs the generator, openapi-python-client, in `.venv-client`: it wants an older typer than ours.
"""

import json
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
GENERATOR = ROOT / ".venv-client"
CONFIG = {
    "post_hooks": [],
    "content_type_overrides": {"application/zip": "application/octet-stream"},
}


@pytest.mark.skipif(
    not (GENERATOR / ".done").is_file(), reason="NO GENERATOR OF CLIENTS: `make client` installs it"
)
def test_a_generated_client_plays_an_episode_to_its_end(server, tmp_path):
    description, config = tmp_path / "openapi.json", tmp_path / "config.json"
    description.write_text(server.client().get("/openapi.json").text)
    config.write_text(json.dumps(CONFIG))
    generate = [
        GENERATOR / "bin/openapi-python-client",
        "generate",
        "--fail-on-warning",
        "--meta=none",
    ]
    generate += ["--path", description, "--config", config, "--output-path", tmp_path / "client"]
    subprocess.run(generate, check=True, timeout=120)
    play = [
        GENERATOR / "bin/python",
        ROOT / "tests/support/generated_player.py",
        tmp_path,
        server.url,
    ]
    played = subprocess.run(play, check=True, capture_output=True, text=True, timeout=120)
    outcome, moves, coverage = played.stdout.split()
    (episode,) = server.client().get("/api/episodes").json()
    assert (episode["outcome"], episode["steps"]) == (outcome, int(moves))
    assert episode["coverage"] == float(coverage)
    assert outcome in ("explored", "timed_out")
