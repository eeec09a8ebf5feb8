"""What a policy's card says of the code that made it."""

import importlib.util
import shutil
import subprocess

from humanplay.tasks.mars.cli import cards


def git(folder, *arguments):
    author = ("-c", "user.name=a", "-c", "user.email=a@example.org")
    command = ["git", "-C", str(folder), *author, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def cards_in(packages):
    """The module as it is where the package was copied to."""
    copy = packages / "app" / "humanplay" / "tasks" / "mars" / "cli" / "cards.py"
    copy.parent.mkdir(parents=True)
    shutil.copy(cards.__file__, copy)
    spec = importlib.util.spec_from_file_location("copied_cards", copy)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_commit_is_that_of_the_checkout_the_code_runs_from(tmp_path):
    copied = cards_in(tmp_path)
    assert copied.commit() is None
    git(tmp_path, "init")
    assert copied.commit() is None, "nothing is committed"
    git(tmp_path, "commit", "--allow-empty", "-m", "first")
    assert copied.commit() == git(tmp_path, "rev-parse", "HEAD").strip()


def test_a_package_in_somebody_elses_checkout_has_no_commit(tmp_path):
    git(tmp_path, "init")
    git(tmp_path, "commit", "--allow-empty", "-m", "somebody else's work")
    assert cards_in(tmp_path / ".venv" / "lib" / "site-packages").commit() is None
