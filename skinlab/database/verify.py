"""Compute random entries of a database again and compare."""

from __future__ import annotations

import numpy as np

from skinlab.database.build import compute_entry
from skinlab.database.grid import GridDatabase
from skinlab.errors import InputError
from skinlab.fem.suction import MESH_OF_RECORD, SOLVER_VERSION

TOLERANCE_MM = 1e-6  # other processors round differently; the numbers mean no more than this


def rebuilt_differences(grid: GridDatabase, samples: int, seed: int) -> list[str]:
    """Return a sentence for each entry, of `samples` random ones, that comes out differently.

    Raises:
        InputError: samples is not within 1 and the number of entries.
    """
    if not 1 <= samples <= grid.spec.entries:
        raise InputError(f"samples {samples}: expected 1–{grid.spec.entries}")
    if (grid.mesh_name, grid.solver_version) != (MESH_OF_RECORD.name, SOLVER_VERSION):
        return [
            f"built with mesh {grid.mesh_name}, solver {grid.solver_version}; "
            f"this is {MESH_OF_RECORD.name}, {SOLVER_VERSION}"
        ]
    found = []
    entries = np.random.default_rng(seed).choice(grid.spec.entries, samples, replace=False)
    for entry in entries.tolist():
        _, curve, holds_to, _ = compute_entry(grid.spec, entry)
        at = np.unravel_index(entry, grid.spec.shape[:3])
        stored = grid.deflection_mm[at]
        same = np.allclose(curve, stored, rtol=0, atol=TOLERANCE_MM, equal_nan=True)
        if not same or abs(holds_to - grid.holds_to_mbar[at]) > 0.5:
            x1, x2, nu = grid.spec.parameters(entry)
            worst = float(np.nanmax(np.abs(curve - stored)))
            found.append(f"entry X1 {x1:g}, X2 {x2:g}, nu {nu:g} differs by {worst:.3g} mm")
    return found
