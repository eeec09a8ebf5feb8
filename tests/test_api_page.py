"""docs/api.md: its two episodes run against a server."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

PAGE = (Path(__file__).parents[1] / "docs/api.md").read_text()


def block(kind, server):
    """The page's lines of a kind, ten at most, for a server that runs elsewhere."""
    (text,) = re.findall(rf"^```{kind}\n(.*?)^```", PAGE, re.M | re.S)
    assert len(text.splitlines()) == 10
    return text.replace("http://127.0.0.1:8000", server.url)


def ended(server):
    (episode,) = server.client().get("/api/episodes").json()
    return episode


def test_ten_lines_of_python_drive_a_whole_episode(server, capsys):
    names = {}
    exec(compile(block("python", server), "docs/api.md", "exec"), names)
    names["api"].close()
    episode = ended(server)
    assert episode["driver"] == "script"
    assert episode["outcome"] in ("explored", "timed_out")
    assert capsys.readouterr().out.startswith(
        f"{episode['outcome']} after {episode['steps']} moves"
    )


@pytest.mark.skipif(shutil.which("curl") is None, reason="NO CURL: its ten lines were not run")
def test_ten_lines_of_curl_drive_a_whole_episode(server):
    lines = block("sh", server)
    done = subprocess.run(
        ["sh", "-c", lines], capture_output=True, text=True, check=True, timeout=60
    )
    episode = ended(server)
    assert episode["outcome"] in ("collided", "out_of_bounds")
    assert f'"outcome":"{episode["outcome"]}"' in done.stdout.replace(" ", "")
