"""What several tests share."""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections.abc import Iterable, Iterator
from itertools import groupby, zip_longest
from pathlib import Path
from typing import cast

# Tests start hundreds of interpreters: without bytecode each would compile all that it imports,
# which is most of its time
if os.environ.pop("PYTHONDONTWRITEBYTECODE", None):
    sys.dont_write_bytecode = False

import pytest
from empty_pictures import leave_pictures_empty
from hypothesis import HealthCheck, settings
from patience import be_patient

from sim_device.timing import TIMING
from skinlab.tables.store import shipped_grid, shipped_table
from skinlab.tables.table import Table

# A shell that starts the tests in the background lets them and all that they start ignore Ctrl-C,
# and `nohup` a hang-up
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

# No test may depend on how fast the machine is
be_patient()
settings.register_profile("patient", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("patient")


# Of the processes of pytest-xdist
_WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
_WORKERS = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))

# `SOAK_DONE=FILE pytest -m soak …` goes on where it was stopped, by whatever
_SOAK_DONE = Path(os.environ["SOAK_DONE"]) if os.environ.get("SOAK_DONE") else None


class _FromElsewhere(pytest.Dir):
    """A folder of which each process imports another file first.

    In a fresh clone each file of tests is compiled where it is imported first, and processes in
    step would all compile all of them: a third of what collecting takes.
    """

    def collect(self) -> Iterable[pytest.Item | pytest.Collector]:
        nodes = list(super().collect())
        begin = len(nodes) * _WORKER // _WORKERS
        return nodes[begin:] + nodes[:begin]


def pytest_collect_directory(path: Path, parent: pytest.Collector) -> pytest.Dir | None:
    if not _WORKER:
        return None
    return cast(pytest.Dir, _FromElsewhere.from_parent(parent, path=path))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Try screens and other processes once more: what a busy machine delays is not wrong yet.

    Not those that say themselves how often. What `SOAK_DONE` names has passed.
    """
    items.sort(key=lambda item: item.path)  # the processes have to agree
    done = set[str]()
    if _SOAK_DONE is not None and _SOAK_DONE.exists():
        done.update(_SOAK_DONE.read_text(encoding="utf-8").splitlines())
        config.hook.pytest_deselected(items=[item for item in items if item.nodeid in done])
        items[:] = [item for item in items if item.nodeid not in done]
    for item in items:
        if _waits(item) and not item.get_closest_marker("flaky"):
            item.add_marker(pytest.mark.flaky(reruns=1))
    items[:] = _mixed(items)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Show how a test failed that was tried again."""
    for report in terminalreporter.getreports("rerun"):
        terminalreporter.write_sep("-", report.nodeid)
        terminalreporter.write_line("\n".join(report.longreprtext.splitlines()[-12:]))


def _waits(item: pytest.Item) -> bool:
    return bool({"tui", "system"} & set(item.path.parts))


def _mixed(items: list[pytest.Item]) -> list[pytest.Item]:
    """Return the items with files that wait for others and files that compute in turn.

    One kind after the other would leave the processors idle first, and fight for them then.
    """
    files = [list(group) for _, group in groupby(items, key=lambda item: item.path)]
    waiting = [file for file in files if _waits(file[0])]
    computing = [file for file in files if not _waits(file[0])]
    turns = zip_longest(waiting, computing, fillvalue=[])
    return [item for turn in turns for file in turn for item in file]


def pytest_collection_finish() -> None:
    """What was imported by now stays: no search for garbage need go through it."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Note what of a soak has passed."""
    if _SOAK_DONE is not None and report.when == "call" and report.passed:
        with _SOAK_DONE.open("a", encoding="utf-8") as file:
            file.write(f"{report.nodeid}\n")


@pytest.fixture(scope="session")
def grid() -> Table:
    return shipped_grid()


@pytest.fixture(scope="session")
def table() -> Table:
    return shipped_table()


@pytest.fixture
def coarse_skin(monkeypatch: pytest.MonkeyPatch) -> None:
    """Solve simulated skins coarsely, where it matters that there is one and not which."""
    monkeypatch.setattr(TIMING, "coarse_skin", True)


@pytest.fixture
def empty_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Put empty pictures into reports whose words are the point: they take most of the time."""
    leave_pictures_empty(monkeypatch)


@pytest.fixture(scope="session", autouse=True)
def nobodys_folders(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What skinlab keeps for its user is neither read nor written by a test or its processes."""
    with pytest.MonkeyPatch.context() as patch:
        for kind in ("CACHE", "CONFIG", "DATA", "STATE"):
            patch.setenv(f"XDG_{kind}_HOME", str(tmp_path_factory.mktemp(kind.lower())))
        yield
