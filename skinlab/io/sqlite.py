"""What every database is looked at for before it is read."""

from __future__ import annotations

import sqlite3


def check_only_tables(database: sqlite3.Connection) -> None:
    """Refuse views and triggers: we make none, and reading one can run for ever.

    Raises:
        sqlite3.DatabaseError: it has some, or is damaged.
    """
    query = "SELECT count(*) FROM sqlite_master WHERE type IN ('view', 'trigger')"
    if database.execute(query).fetchone()[0]:
        raise sqlite3.DatabaseError("it holds statements of its own, and none are expected")
