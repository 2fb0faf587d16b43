"""Compute a grid's curves with the finite elements, on as many cores as asked for."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from skinlab.database.dimensionless import DimensionlessSpec, DimensionlessTable, compute_row
from skinlab.database.grid import GridDatabase, GridSpec
from skinlab.database.support import supported
from skinlab.fem.admissibility import NO_LIMITS
from skinlab.fem.newton import StepSettings
from skinlab.fem.suction import MESH_OF_RECORD, SOLVER_VERSION, assembly_for, solve
from skinlab.materials.compressibility import kappa_ratio

Array = NDArray[np.float64]

R = TypeVar("R")
Progress = Callable[[int, int], None]
Row = tuple[int, Array, float, int]  # entry, deflections (p,), holds to, iterations


def compute_entry(spec: GridSpec, entry: int) -> Row:
    """Return one entry's curve on the spec's pressures.

    Where the skin creases before the last pressure, the curve goes on along the creased branch: it
    supports the interpolation of neighbours that hold, and is never given as an answer itself.
    """
    x1, x2, nu = spec.parameters(entry)
    parameters = {"X1_MPa": x1, "X2_MPa": x2, "kappa_MPa": x1 * kappa_ratio(nu, spec.kappa)}
    top = max(spec.pressure_mbar)
    curve = held = solve(spec.geometry, parameters, top, law=spec.law)
    if held.stopped:
        unchecked = StepSettings(limits=NO_LIMITS)
        curve = solve(spec.geometry, parameters, top, law=spec.law, settings=unchecked)
    return entry, curve(np.array(spec.pressure_mbar)), held.holds_to_mbar, curve.iterations


def build_grid(
    spec: GridSpec, workers: int = 1, progress: Progress = lambda done, total: None
) -> GridDatabase:
    """Return the built grid; the numbers do not depend on `workers`.

    `progress` is called with (done, total) after each entry.
    """
    deflection = np.full(spec.shape, np.nan)
    holds = np.zeros(spec.shape[:3])
    iterations = np.zeros(spec.shape[:3], dtype=np.int32)
    rows = _computed(partial(compute_entry, spec), spec.entries, workers)
    for done, (entry, curve, holds_to, spent) in enumerate(rows, start=1):
        at = np.unravel_index(entry, spec.shape[:3])
        deflection[at], holds[at], iterations[at] = curve, holds_to, spent
        progress(done, spec.entries)
    assembly, _ = assembly_for(spec.geometry, MESH_OF_RECORD, spec.law)
    return GridDatabase(
        spec, deflection, holds, iterations, MESH_OF_RECORD.name, SOLVER_VERSION, assembly.n
    )


def build_table(
    spec: DimensionlessSpec, workers: int = 1, progress: Progress = lambda done, total: None
) -> DimensionlessTable:
    """Return the built table; the numbers do not depend on `workers`.

    `progress` is called with (done, total) after each entry.
    """
    compliance = np.full((*spec.shape, spec.load_nodes), np.nan)
    holds = np.zeros(spec.shape)
    rows = _computed(partial(compute_row, spec), spec.entries, workers)
    for done, (entry, row, holds_to) in enumerate(rows, start=1):
        at = np.unravel_index(entry, spec.shape)
        compliance[at], holds[at] = row, holds_to
        progress(done, spec.entries)
    filled = supported(compliance, spec.load_coordinates()).astype(np.float32)
    return DimensionlessTable(spec, filled, holds, MESH_OF_RECORD.name, SOLVER_VERSION)


def _computed(compute: Callable[[int], R], entries: int, workers: int) -> Iterator[R]:
    if workers <= 1:
        yield from map(compute, range(entries))
        return
    # One thread of linear algebra a process: the cores are shared out by entries.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        yield from pool.map(compute, range(entries), chunksize=8)
