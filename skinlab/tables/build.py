"""Build a database: compute its rows with the finite elements, and put them in order."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from skinlab.mechanics.fem.admissibility import NO_LIMITS
from skinlab.mechanics.fem.newton import StepSettings
from skinlab.mechanics.fem.suction import MESH_OF_RECORD, SOLVER_VERSION, assembly_for, solve
from skinlab.mechanics.materials.compressibility import kappa_ratio
from skinlab.tables.dimensionless import DimensionlessSpec, DimensionlessTable, compute_row
from skinlab.tables.grid import GridDatabase, GridSpec
from skinlab.tables.parallel_build import How, compute_rows
from skinlab.tables.support import supported

Array = NDArray[np.float64]

HERE = How()


def compute_entry(spec: GridSpec, entry: int) -> Array:
    """Return one entry's curve on the spec's pressures (p,), to which mbar it holds, iterations.

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
    deflection = curve(np.array(spec.pressure_mbar))
    return np.append(deflection, [held.holds_to_mbar, curve.iterations])


def build_grid(spec: GridSpec, how: How = HERE) -> GridDatabase:
    """Return the built grid.

    Raises:
        InputError: see `compute_rows`.
    """
    rows = compute_rows(
        partial(compute_entry, spec), _all_of(spec), spec.entries, spec.shape[3] + 2, how
    )
    assembly, _ = assembly_for(spec.geometry, MESH_OF_RECORD, spec.law)
    return GridDatabase(
        spec,
        np.ascontiguousarray(rows[:, :-2]).reshape(spec.shape),
        np.ascontiguousarray(rows[:, -2]).reshape(spec.shape[:3]),
        rows[:, -1].astype(np.int32).reshape(spec.shape[:3]),
        MESH_OF_RECORD.name,
        SOLVER_VERSION,
        assembly.n,
    )


def build_table(spec: DimensionlessSpec, how: How = HERE) -> DimensionlessTable:
    """Return the built table.

    Raises:
        InputError: see `compute_rows`.
    """
    rows = compute_rows(
        partial(compute_row, spec), _all_of(spec), spec.entries, spec.load_nodes + 1, how
    )
    compliance = rows[:, :-1].reshape(*spec.shape, -1)
    filled = supported(compliance, spec.load_coordinates()).astype(np.float32)
    holds = np.ascontiguousarray(rows[:, -1]).reshape(spec.shape)
    return DimensionlessTable(spec, filled, holds, MESH_OF_RECORD.name, SOLVER_VERSION)


def _all_of(spec: GridSpec | DimensionlessSpec) -> str:
    return repr((spec, MESH_OF_RECORD.name, SOLVER_VERSION))
