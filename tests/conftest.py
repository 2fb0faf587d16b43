"""What several tests share."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator

# Tests start hundreds of interpreters: without bytecode each would compile all that it imports,
# which is most of its time
if os.environ.pop("PYTHONDONTWRITEBYTECODE", None):
    sys.dont_write_bytecode = False

import pytest
from hypothesis import HealthCheck, settings
from patience import be_patient

from skinlab.tables.store import shipped_grid, shipped_table
from skinlab.tables.table import Table

# No test may depend on how fast the machine is
be_patient()
settings.register_profile("patient", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("patient")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Try screens and other processes once more: what a busy machine delays is not wrong yet."""
    for item in items:
        if {"tui", "system"} & set(item.path.parts):
            item.add_marker(pytest.mark.flaky(reruns=1))


@pytest.fixture(scope="session")
def grid() -> Table:
    return shipped_grid()


@pytest.fixture(scope="session")
def table() -> Table:
    return shipped_table()


@pytest.fixture(scope="session", autouse=True)
def nobodys_folders(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What skinlab keeps for its user is neither read nor written by a test or its processes."""
    with pytest.MonkeyPatch.context() as patch:
        for kind in ("CACHE", "CONFIG", "DATA", "STATE"):
            patch.setenv(f"XDG_{kind}_HOME", str(tmp_path_factory.mktemp(kind.lower())))
        yield
