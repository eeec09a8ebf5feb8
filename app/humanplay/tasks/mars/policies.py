"""The policies that may be watched or played against, by name."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from humanplay.task import Configuration, NotReadyError, PolicyOffer
from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies import Policy
from marsexplorer.policies.files.imported import wrong_size


class PolicyCatalogue:
    """The policies on offer: those that load by name, and further ones from paths.

    The shipped ones play every size, and are loaded when somebody chooses them. A file is loaded and decides once before
    anybody can, so that one that is no policy is found at the start.
    """

    def __init__(self, paths: Iterable[Path] = ()) -> None:
        offers = [
            PolicyOffer(name, policies.describe(name), name, None, True)
            for name in policies.names()
        ]
        self._offers = {offer.name: offer for offer in (*offers, *map(_try_out, paths))}

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


def _try_out(path: Path) -> PolicyOffer:
    """Return the offer of a file whose policy decides and moves; PolicyFileError or PolicyNotFoundError where it is none."""
    while True:
        try:
            policy = policies.load(path)
            policy.reset(0)
            size: tuple[int, int] | None = getattr(policy, "size", None)
            episode = Episode.begin(EnvConfig.of("random", size or 5), seed=0)
            episode.step(policy.act(episode.codes.copy()))
            return PolicyOffer(policy.name, policies.describe(str(path)), str(path), size, False)
        except NotReadyError as error:
            error.ready.result()
