"""Compute random entries of a database again and compare."""

from __future__ import annotations

import numpy as np

from skinlab.database.build import compute_entry
from skinlab.database.dimensionless import DimensionlessTable, compute_row
from skinlab.database.grid import GridDatabase
from skinlab.errors import InputError
from skinlab.fem.suction import MESH_OF_RECORD, SOLVER_VERSION

# Other processors round differently; the numbers mean no more than this.
TOLERANCE_MM = 1e-6
TOLERANCE_LOG = 1e-6


def rebuilt_differences(
    database: GridDatabase | DimensionlessTable, samples: int, seed: int
) -> list[str]:
    """Return a sentence for each entry, of `samples` random ones, that comes out differently.

    Raises:
        InputError: samples is not within 1 and the number of entries.
    """
    total = database.spec.entries
    if not 1 <= samples <= total:
        raise InputError(f"samples {samples}: expected 1–{total}")
    if (database.mesh_name, database.solver_version) != (MESH_OF_RECORD.name, SOLVER_VERSION):
        return [
            f"built with mesh {database.mesh_name}, solver {database.solver_version}; "
            f"this is {MESH_OF_RECORD.name}, {SOLVER_VERSION}"
        ]
    entries = np.random.default_rng(seed).choice(total, samples, replace=False).tolist()
    if isinstance(database, GridDatabase):
        found = [_grid_difference(database, entry) for entry in entries]
    else:
        found = [_table_difference(database, entry) for entry in entries]
    return [sentence for sentence in found if sentence]


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
