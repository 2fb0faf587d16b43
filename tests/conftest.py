"""What several tests share."""

from __future__ import annotations

import pytest

from skinlab.database.dimensionless import DimensionlessTable
from skinlab.database.grid import GridDatabase
from skinlab.database.store import shipped_grid, shipped_table


@pytest.fixture(scope="session")
def grid() -> GridDatabase:
    return shipped_grid()


@pytest.fixture(scope="session")
def table() -> DimensionlessTable:
    return shipped_table()
