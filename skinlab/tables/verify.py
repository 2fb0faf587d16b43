"""Compute random entries of a database again and compare."""

from __future__ import annotations

import numpy as np

from skinlab.errors import InputError
from skinlab.mechanics.fem.suction import MESH_OF_RECORD, SOLVER_VERSION
from skinlab.tables.build import compute_entry
from skinlab.tables.dimensionless import DimensionlessTable, compute_row
from skinlab.tables.grid import GridDatabase
from skinlab.tables.model_build import compute_curve, node
from skinlab.tables.model_database import ModelDatabase

# Other processors round differently; the numbers mean no more than this.
TOLERANCE_MM = 1e-6
TOLERANCE_LOG = 1e-6


def rebuilt_differences(
    database: GridDatabase | DimensionlessTable | ModelDatabase, samples: int, seed: int
) -> list[str]:
    """Return a sentence for each entry, of `samples` random ones, that comes out differently.

    Raises:
        InputError: samples is not within 1 and the number of entries.
    """
    total = database.spec.entries
    if not 1 <= samples <= total:
        raise InputError(f"samples {samples}: expected 1–{total}")
    here = database.mesh_name if isinstance(database, ModelDatabase) else MESH_OF_RECORD.name
    if (database.mesh_name, database.solver_version) != (here, SOLVER_VERSION):
        return [
            f"built with mesh {database.mesh_name}, solver {database.solver_version}; "
            f"this is {here}, {SOLVER_VERSION}"
        ]
    entries = np.random.default_rng(seed).choice(total, samples, replace=False).tolist()
    if isinstance(database, ModelDatabase):
        found = [_model_difference(database, entry) for entry in entries]
    elif isinstance(database, GridDatabase):
        found = [_grid_difference(database, entry) for entry in entries]
    else:
        found = [_table_difference(database, entry) for entry in entries]
    return [sentence for sentence in found if sentence]


def _model_difference(database: ModelDatabase, entry: int) -> str:
    spec, nodes = database.spec, database.course.nodes
    at = np.unravel_index(entry, spec.shape)
    computed = compute_curve(spec, entry).reshape(-1, len(nodes))
    stored = database.curves[at].reshape(-1, len(nodes))
    held = nodes <= database.holds_to[at]  # beyond: filled, not computed
    off = np.abs(computed - stored)[:, held]
    if np.all(off <= TOLERANCE_MM):
        return ""
    named = zip(spec.axis, node(spec, entry), strict=True)
    worst = float(np.max(off))
    return (
        f"entry {', '.join(f'{name} {value:g}' for name, value in named)} differs by {worst:.3g} mm"
    )


def _grid_difference(grid: GridDatabase, entry: int) -> str:
    row = compute_entry(grid.spec, entry)
    curve, holds_to = row[:-2], row[-2]
    at = np.unravel_index(entry, grid.spec.shape[:3])
    stored = grid.deflection_mm[at]
    same = np.allclose(curve, stored, rtol=0, atol=TOLERANCE_MM, equal_nan=True)
    if same and abs(holds_to - grid.holds_to_mbar[at]) <= 0.5:
        return ""
    x1, x2, nu = grid.spec.parameters(entry)
    worst = float(np.nanmax(np.abs(curve - stored)))
    return f"entry X1 {x1:g}, X2 {x2:g}, nu {nu:g} differs by {worst:.3g} mm"


def _table_difference(table: DimensionlessTable, entry: int) -> str:
    *computed, holds_to = compute_row(table.spec, entry)
    row = np.array(computed)
    at = np.unravel_index(entry, table.spec.shape)
    worst = float(np.nanmax(np.abs(row - table.log_compliance[at])))  # NaN: filled, not computed
    stored = float(table.holds_to_load[at])
    if worst <= TOLERANCE_LOG and abs(holds_to - stored) <= 5e-3 * stored:
        return ""
    return f"entry {tuple(int(k) for k in at)} differs by {worst:.3g} of its deflection"
