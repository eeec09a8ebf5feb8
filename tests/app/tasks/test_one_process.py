"""One prepared process is the only place where an environment steps."""

import os
import subprocess
import sys

import pytest

from humanplay.task.registration import environment_of
from tests.app.tasks.test_gymnasium import begin, play
from tests.support.recorded import ask

SETS = "gymnasium:tests.support.odd_environments:Odd-sets-v0"
"""Its observations are ordered by the hash seed."""


@pytest.mark.parametrize("hash_seed", ["1", "77"])
def test_an_episode_is_verified_whatever_the_shell_s_hash_seed_is(serve, tmp_path, hash_seed):
    server = serve(task=SETS)
    client = server.page()
    play(server, client, begin(server, client), ["1"], input=None)
    server.stop()
    path = tmp_path / "playground.db"
    assert ask(path, "SELECT steps FROM episodes") == [(30,)]
    done = subprocess.run(
        [sys.executable, "-m", "humanplay.cli", "verify", "--database", str(path)],
        env={**os.environ, "PYTHONHASHSEED": hash_seed},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr


def test_what_an_environment_prints_or_changes_stays_in_its_process():
    environment = environment_of("gymnasium:tests.support.odd_environments:Odd-module-v0")
    digests = {environment.run(environment.default, 1, bytes([1, 2])).digest for _ in range(3)}
    assert len(digests) == 1
