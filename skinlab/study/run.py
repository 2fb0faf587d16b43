"""Bring a study's state up to date: look at the folders, compute what is new or changed.

Processes of this machine, or the workers of a dask cluster, compute; this process alone writes.
However many there are, the rows are the same bits, and no more than a few batches are in memory.
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context, parent_process
from typing import Any

from skinlab import __version__
from skinlab.errors import InputError
from skinlab.inference.identify import Identifier
from skinlab.recording.recorder import identification_settings
from skinlab.study.cluster import computed_on_cluster
from skinlab.study.compute import Computed, Task, compute
from skinlab.study.sources import (
    NOISE,
    SESSIONS,
    SETUP,
    Plan,
    Source,
    Table,
    find_sources,
    pseudonym,
    sha256_of,
)
from skinlab.study.state import State

__all__ = ["How", "end_with_parent", "settings_of", "update"]

_BATCH = 8  # files a task: a second of work, lost at most when a process is killed
_AHEAD = 2  # batches a process that wait, so that none of them idles

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class How:
    """Where to compute; `progress` is called with files (done, total) as they come."""

    workers: int = 1
    dask: str | None = None
    progress: Progress = lambda done, total: None


def settings_of(identifier: Identifier) -> str:
    """Return all of the identification that its answers depend on, as JSON."""
    said = {**identification_settings(identifier), "skinlab": __version__}
    said.pop("database_path", None)  # its hash says which it is, wherever it lies
    return json.dumps(said, sort_keys=True)


def update(state: State, plan: Plan, identifier: Identifier, how: How, *, resume: bool) -> None:
    """Bring the state up to date with the folders.

    Raises:
        InputError: a folder does not exist; or, with `resume`, what is there was identified in
            another way.
    """
    settings = settings_of(identifier)
    if resume and state.settings is not None and state.settings != settings:
        differ = _differences(json.loads(state.settings), json.loads(settings))
        raise InputError(
            f"{state.path}: computed with other settings ({differ}); without --resume all curves "
            "are computed again"
        )
    _scan(state, plan, settings)
    total, done = state.counts()
    how.progress(done, total)
    for computed in _results(state, identifier, how):
        state.add(computed, state.wanted(c.number for c in computed))
        done += len(computed)
        how.progress(done, total)


def _differences(before: dict[str, Any], now: dict[str, Any]) -> str:
    return ", ".join(
        f"{k}: {before.get(k)} then, {now.get(k)} now"
        for k in sorted({*before, *now})
        if before.get(k) != now.get(k)
    )


def _scan(state: State, plan: Plan, settings: str) -> None:
    scan = state.begin(settings)
    for found in find_sources(plan):
        if isinstance(found, Table):
            for _, cells in found.rows:
                if "subject" in cells:
                    facts = {k: v for k, v in cells.items() if k != "subject"}
                    state.person(pseudonym(cells["subject"]), facts)
            continue
        wanted, error = "", found.error
        if error is None:
            try:
                wanted = _wanted(found, settings)
            except OSError as problem:
                error = f"{found.path}: {problem.strerror or problem}"
        state.found(scan, found.name, found.path.absolute(), found.facts, wanted, error)
    state.end(scan)


def _wanted(source: Source, settings: str) -> str:
    """Return a hash of all that the rows of this file depend on: labels are not among it."""
    used: dict[str, Any] = {}
    if source.path.suffix.lower() not in SESSIONS:
        used = {k: v for k, v in source.facts.items() if k in (*SETUP, *NOISE)}
    said = json.dumps([sha256_of(source.path), used, settings, source.path.name], sort_keys=True)
    return hashlib.sha256(said.encode()).hexdigest()


def _results(state: State, identifier: Identifier, how: How) -> Iterator[list[Computed]]:
    batches = state.pending(_BATCH)
    if how.dask is not None:
        yield from computed_on_cluster(identifier, batches, how.dask)
    elif how.workers <= 1:
        for batch in batches:
            yield compute(identifier, batch)
    else:
        yield from _by_processes(identifier, batches, how.workers)


# ---- processes ------------------------------------------------------------------------------

_identifier: Identifier | None = None  # of a worker process


def _start_worker(identifier: Identifier) -> None:
    global _identifier  # noqa: PLW0603 -- a worker's only state, set once when it starts
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides
    _identifier = identifier
    end_with_parent()


def end_with_parent() -> None:
    """End this process when the one that started it is killed: nothing else would tell it."""
    parent = parent_process()
    if parent is None:
        return

    def wait_for_it() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait_for_it, daemon=True).start()


def _compute(tasks: Sequence[Task]) -> list[Computed]:
    assert _identifier is not None
    return compute(_identifier, tasks)


def _by_processes(
    identifier: Identifier, batches: Iterator[list[Task]], workers: int
) -> Iterator[list[Computed]]:
    """Yield what worker processes compute; where one dies, its files are tried one by one."""
    # One thread of linear algebra a process: the cores are shared out by files.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    batch = next(batches, None)
    while batch is not None:
        pool = _pool(identifier, workers)
        running: dict[Future[list[Computed]], list[Task]] = {}
        suspects: list[Task] = []
        try:
            while not suspects:
                while batch is not None and len(running) < workers * (1 + _AHEAD):
                    running[pool.submit(_compute, batch)] = batch
                    batch = next(batches, None)
                if not running:
                    break
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    tasks = running.pop(future)
                    try:
                        yield future.result()
                    except BrokenProcessPool:
                        suspects += tasks
        except BrokenProcessPool:
            pass  # submitted to after it broke: that batch is still to come
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
        suspects += [task for tasks in running.values() for task in tasks]
        for task in suspects:
            yield [_alone(identifier, task)]


def _alone(identifier: Identifier, task: Task) -> Computed:
    """Return what one file gives in a process of its own."""
    pool = _pool(identifier, 1)
    try:
        return pool.submit(_compute, [task]).result()[0]
    except BrokenProcessPool:
        reason = f"{task.path}: the process that read it died"
        return Computed(task.number, "", (), reason, again=True)
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _pool(identifier: Identifier, workers: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(
        workers,
        mp_context=get_context("spawn"),
        initializer=_start_worker,
        initargs=(identifier,),
    )
