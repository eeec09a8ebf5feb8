"""Policies: random moves, the frontier rules, and trained networks from files.

`load(name_or_path)` returns a `Policy`, `names()` lists what loads by name with the best default
first, and `describe(name)` describes a policy in a sentence. Networks need the extra `play`; the
rules do not.
"""

from marsexplorer.policies.base import Policy, PolicyFileError, PolicyNotFoundError, begin, goal_of
from marsexplorer.policies.loading import (
    describe,
    find_file,
    find_shipped,
    is_rule,
    load,
    names,
    policy_hash,
    title,
)

__all__ = [
    "Policy",
    "PolicyFileError",
    "PolicyNotFoundError",
    "begin",
    "describe",
    "find_file",
    "find_shipped",
    "goal_of",
    "is_rule",
    "load",
    "names",
    "policy_hash",
    "title",
]
