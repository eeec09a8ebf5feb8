"""What the database keeps of studies: participants, their stages, trials and input events.

Works on the store's connection and in its transactions: `app.store` stays the one writer.
"""

from __future__ import annotations

from app.store import Store
from app.study.folder import Study


class Records:
    """The tables of studies in a store's database."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._conn = store._conn

    def note_closed(self, study: Study) -> None:
        """Return with the end and the secret of a closed study noted, if anybody had joined it."""
        if study.is_open:
            return
        with self._store._transaction():
            self._conn.execute(
                "UPDATE studies SET closed_ms = ?, secret = ? WHERE name = ? AND protocol_hash = ? AND closed_ms IS NULL",
                (study.closed_ms, study.secret.hex(), study.name, study.protocol_hash),
            )
