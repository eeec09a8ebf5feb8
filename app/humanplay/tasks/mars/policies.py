"""The policies that may be watched or played against, by name."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from humanplay.task import Configuration, PolicyOffer
from marsexplorer import policies
from marsexplorer.config import MAP, OTHER_LEVELS, EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies import Policy
from marsexplorer.policies.files.imported import wrong_size


class PolicyCatalogue:
    """The policies on offer: those that load by name, and further ones from paths.

    Loading each once at the start finds a file that is no policy before anybody chooses it. One decision and one move of
    each compile the kernels and the rules. A building and a cave compile what draws them.
    """

    def __init__(self, paths: Iterable[Path] = ()) -> None:
        self._offers: dict[str, PolicyOffer] = {}
        shipped = policies.names()
        for source in (*shipped, *map(str, paths)):
            policy = policies.load(source)
            policy.reset(0)
            size: tuple[int, int] | None = getattr(policy, "size", None)
            episode = Episode.begin(EnvConfig.of("random", size or 5), seed=0)
            episode.step(policy.act(episode.codes.copy()))
            self._offers[policy.name] = PolicyOffer(
                policy.name, policies.describe(source), source, size, policy.name in shipped
            )
        for level in (name for name in OTHER_LEVELS if name != MAP):
            Episode.begin(EnvConfig.of(level, (6, 8)), seed=1)

    def offers(self) -> list[PolicyOffer]:
        """Return what may be chosen."""
        return list(self._offers.values())

    def check(self, name: str, *others: str) -> str:
        """Return the name when it is on offer; ValueError naming the choices (and `others`) otherwise."""
        if name not in self._offers:
            offered = ", ".join((*others, *self._offers))
            raise ValueError(f"no policy {name!r}; choose one of: {offered}")
        return name

    def check_size(self, names: Iterable[str], config: EnvConfig) -> None:
        """Raise ValueError, naming the policy, unless every policy among the names plays boards of this size."""
        for name in names:
            size = self._offers[name].size if name in self._offers else None
            if size not in (None, (config.rows, config.cols)):
                raise ValueError(wrong_size(name, size, (config.rows, config.cols)))

    def load(self, name: str) -> Policy:
        """Return a new policy object: a policy remembers its episode, so each board needs its own."""
        return policies.load(self._offers[self.check(name)].source)

    def reset(self, policy: Any, config: Configuration, seed: int) -> None:
        """Reset a policy for an episode of a configuration."""
        policies.begin(policy, config.level, seed)


def check_file(path: Path) -> None:
    """Read what a policy file says of itself; PolicyFileError or PolicyNotFoundError where there is none."""
    policies.describe(str(path))
