"""Daily attempts put into a store as the server does it."""

from app.board.daily import day_start_ms, seed_of, terrain_of_day
from app.db.playground import daily_secret, keep_terrain
from app.db.store import DailyDay, Store
from marsexplorer.config import EnvConfig
from tests.support.recorded import play

CONFIG = EnvConfig("random", 9, 13, sensor_radius=3)
"""Large enough that two seeds do not draw the same terrain by chance."""
DAY = "2026-11-22"
DURING_MS = day_start_ms(DAY) + 3_600_000
AFTER_MS = day_start_ms(DAY) + 86_400_000


def small_terrain(store: Store, day: str = DAY):
    """Keep and return the terrain that a day has in this store, on a small board."""
    terrain = terrain_of_day(daily_secret(store), day, "mars", CONFIG)
    keep_terrain(store, terrain)
    return terrain


def play_daily(store: Store, player: str = "ada", day: str = DAY, **rest):
    """Return the row of a player's finished attempt at a day's terrain."""
    terrain = small_terrain(store, day)
    daily = DailyDay(day, terrain.commitment)
    return play(
        store,
        seed_of(terrain.key),
        player,
        config=CONFIG,
        daily=daily,
        started_ms=day_start_ms(day) + 5,
        **rest,
    )
