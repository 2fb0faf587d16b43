"""Bring a study's state up to date: look at the folders, compute what is new or changed.

Processes of this machine, or the workers of a dask cluster, compute; this process alone writes.
However many there are, the rows are the same bits, and no more than a few batches are in memory.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from skinlab.errors import InputError
from skinlab.inference.identify import Identifier
from skinlab.recording.recorder import identification_settings
from skinlab.recording.session_names import is_session_name
from skinlab.studies.compute import SESSION_NOISE, Computed, Task, compute
from skinlab.studies.facts import NOISE, PARTIAL, SETUP, pseudonym
from skinlab.studies.sources import (
    Plan,
    Source,
    Table,
    find_sources,
    sha256_of,
)
from skinlab.studies.state import State
from skinlab.versions import versions
from skinlab.workers import on_cluster, on_processes

_VISIT = "day of the measurement"  # what a session's visit is: rows that say another are redone
_NO_MATTER = ("python", "machine")  # of the versions: tables do not state them
_BATCH = 8  # files a task: a second of work, lost at most when a process is killed

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class How:
    """Where to compute.

    `progress` is called with files (done, total) as they come, then `explaining` with campaigns.
    """

    workers: int = 1
    dask: str | None = None
    progress: Progress = lambda done, total: None
    explaining: Progress = lambda done, total: None


def settings_of(identifier: Identifier) -> str:
    """Return all of the identification that its answers depend on, as JSON."""
    running = {k: v for k, v in versions().items() if k not in _NO_MATTER}
    said = {**identification_settings(identifier), **running}
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
    session = is_session_name(source.path)
    names = NOISE if session else (*SETUP, *NOISE, PARTIAL)
    used: dict[str, Any] = {k: v for k, v in source.facts.items() if k in names}
    if session:
        used |= {"visit": _VISIT, "noise": SESSION_NOISE}
    said = json.dumps([sha256_of(source.path), used, settings, source.path.name], sort_keys=True)
    return hashlib.sha256(said.encode()).hexdigest()


def _results(state: State, identifier: Identifier, how: How) -> Iterator[list[Computed]]:
    batches = state.pending(_BATCH)
    if how.dask is not None:
        yield from on_cluster(compute, identifier, batches, how.dask)
    elif how.workers <= 1:
        for batch in batches:
            yield compute(identifier, batch)
    else:
        for batch, found in on_processes(compute, identifier, batches, how.workers):
            yield found if found is not None else _one_by_one(identifier, batch)


def _one_by_one(identifier: Identifier, batch: list[Task]) -> list[Computed]:
    """Return what the files of a batch give whose process died, each in a process of its own."""
    computed = []
    for task in batch:
        for _, found in on_processes(compute, identifier, iter([[task]]), 1):
            reason = f"{task.path}: the process that read it died"
            computed += found or [Computed(task.number, "", (), reason, again=True)]
    return computed
