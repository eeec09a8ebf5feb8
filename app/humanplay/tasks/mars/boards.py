"""The boards of MarsExplorer that people come back to."""

from __future__ import annotations

from humanplay.task import Configuration
from humanplay.tasks.mars.drawn import PLAIN_LEVELS
from humanplay.tasks.mars.narrowing import own_config
from marsexplorer.config import LEVELS, EnvConfig

FIRST_SEED = 1_000_000_000
"""Policies play the terrains of this seed and the next ones: training refuses them."""


class MarsBoards:
    """The leaderboard's boards and the daily terrain's (`humanplay.task.Boards`)."""

    daily = EnvConfig.of("random", 21)
    offered = (
        *(EnvConfig.of(level, 21) for level in LEVELS),
        EnvConfig.of("random", 42),
        EnvConfig.of("random", 84),
    )
    """Those of the page's terrain dialog."""

    def configuration(self, level: str, size: int | tuple[int, int] | None) -> EnvConfig:
        """A level's configuration at a side or (rows, cols); ValueError if there is none."""
        return EnvConfig.of(level, self.daily.size if size is None else size)

    def name_of(self, config: Configuration) -> tuple[str, str]:
        """Level and size, and of other settings than the level's own a part of their hash."""
        rows, cols = own_config(config).size
        name = f"{config.level}-{rows}x{cols}"
        title = f"{PLAIN_LEVELS.get(config.level, config.level)} {rows} × {cols}"
        if config == EnvConfig.of(config.level, (rows, cols)):
            return name, title
        return f"{name}-{config.hash[:8]}", f"{title} (settings {config.hash[:8]})"

    def seeds(self, config: Configuration) -> tuple[int, ...]:
        """Those of 100 terrains, fewer on large grids, where an episode takes seconds."""
        cells = own_config(config).n
        count = 100 if cells <= 900 else 40 if cells <= 2500 else 10
        return tuple(range(FIRST_SEED, FIRST_SEED + count))
