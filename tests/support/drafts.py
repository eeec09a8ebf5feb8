"""A draft, changed as a researcher does with an editor."""

import tomllib

from humanplay.study.draft import FILE, toml
from humanplay.study.questions import NONE


def draft_of(root, name):
    """The path of a study's draft in a folder of studies."""
    return root / name / FILE


def edit_draft(path, **changes):
    """Write other fields into a draft; None becomes its word."""
    words = {name: NONE if content is None else content for name, content in changes.items()}
    path.write_text(toml({**tomllib.loads(path.read_text()), **words}))
