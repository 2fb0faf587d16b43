"""Compute the rows of a database: in this process, on several cores, or on a dask cluster.

A row is all numbers (width,) of one entry. Rows are kept in a file as they come, so that a build
that was killed can go on; whoever computes them, they are the same bits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinlab.errors import InputError
from skinlab.mechanics.fem.suction import SOLVER_VERSION
from skinlab.tables.build_checkpoint import KeptRows
from skinlab.workers import Pool, on_cluster

Array = NDArray[np.float64]
Compute = Callable[[int], Array]
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class How:
    """How to build; the numbers do not depend on it.

    `dask` is the address of a scheduler. Rows are kept in the file `keep` until the build is done;
    with `resume` those that are there already are not computed again. `progress` is called with
    (done, total) after each row.
    """

    workers: int = 1
    dask: str | None = None
    keep: Path | None = None
    resume: bool = False
    progress: Progress = lambda done, total: None


def compute_rows(compute: Compute, what: str, entries: int, width: int, how: How) -> Array:
    """Return the rows (entries, width); `what` says in words all that the numbers depend on.

    Raises:
        InputError: rows are kept there of another build, or without `resume`; or no cluster.
    """
    rows = np.full((entries, width), np.nan)
    done = np.zeros(entries, dtype=bool)
    with ExitStack() as stack:
        kept = None
        if how.keep is not None:
            kept = stack.enter_context(KeptRows(how.keep, what, width, resume=how.resume))
            for entry, row in kept.found():
                if entry < entries:
                    rows[entry], done[entry] = row, True
        missing = np.flatnonzero(~done).tolist()
        count = entries - len(missing)
        if count:
            how.progress(count, entries)
        for entry, row in _computed(compute, missing, how):
            rows[entry] = row
            if kept is not None:
                kept.add(entry, row)
            count += 1
            how.progress(count, entries)
    return rows


def _row(compute: Compute, entry: int) -> tuple[int, Array]:
    return entry, compute(entry)


def _row_of_solver(state: tuple[Compute, str], entry: int) -> tuple[int, Array]:
    compute, version = state
    if version != SOLVER_VERSION:  # a cluster's worker may have another skinlab
        raise InputError(f"a dask worker has solver version {SOLVER_VERSION}; expected {version}")
    return _row(compute, entry)


def _computed(compute: Compute, entries: list[int], how: How) -> Iterator[tuple[int, Array]]:
    if how.dask is not None:
        yield from on_cluster(_row_of_solver, (compute, SOLVER_VERSION), iter(entries), how.dask)
        return
    with Pool(min(how.workers, len(entries)), compute) as pool:
        yield from pool.map(_row, entries)
