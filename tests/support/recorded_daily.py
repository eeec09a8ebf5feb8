"""Daily attempts put into a store as the server does it."""

from humanplay.db.series import add_attempt, add_series, daily_secret
from humanplay.db.store import Store
from humanplay.study.days import DailyTerrain, day_start_ms
from marsexplorer.config import EnvConfig
from tests.support.recorded import play

CONFIG = EnvConfig("random", 9, 13, sensor_radius=3)
"""Large enough that two seeds do not draw the same terrain by chance."""
DAY = "2026-11-22"
DURING_MS = day_start_ms(DAY) + 3_600_000
AFTER_MS = day_start_ms(DAY) + 86_400_000


def small_terrain(store: Store, day: str = DAY):
    """Keep and return the terrain that a day has in this store, on a small board."""
    terrain = DailyTerrain.draw(daily_secret(store), day, "mars", CONFIG)
    add_series(store, terrain.series)
    return terrain


def play_daily(store: Store, player: str = "ada", day: str = DAY, **rest):
    """Return the row of a player's finished attempt at a day's terrain."""
    terrain = small_terrain(store, day)
    series, began = terrain.series.name, day_start_ms(day) + 5
    rest = {"config": CONFIG, "series": series, "started_ms": began, **rest}
    return play(
        store,
        terrain.seed,
        player,
        after=lambda row: add_attempt(store, series, player, row.id),
        **rest,
    )
