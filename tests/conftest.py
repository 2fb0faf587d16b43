"""What several tests share."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, settings
from patience import be_patient

from skinlab.database.dimensionless import DimensionlessTable
from skinlab.database.grid import GridDatabase
from skinlab.database.store import shipped_grid, shipped_table

# No test may depend on how fast the machine is
be_patient()
settings.register_profile("patient", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("patient")


@pytest.fixture(scope="session")
def grid() -> GridDatabase:
    return shipped_grid()


@pytest.fixture(scope="session")
def table() -> DimensionlessTable:
    return shipped_table()
