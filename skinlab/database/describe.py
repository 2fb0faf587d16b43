"""What is in a database, in a few lines."""

from __future__ import annotations

import numpy as np

from skinlab.database.dimensionless import DimensionlessTable
from skinlab.database.grid import GridDatabase
from skinlab.fem.suction import MBAR


def describe(database: GridDatabase | DimensionlessTable) -> str:
    """Return the text."""
    head = (
        f"law {database.law}, mesh {database.mesh_name}, solver version {database.solver_version}"
    )
    lines = _grid(database) if isinstance(database, GridDatabase) else _table(database)
    return "\n".join([head, *lines, database.content_hash])


def _grid(grid: GridDatabase) -> list[str]:
    spec = grid.spec
    top = max(spec.pressure_mbar)
    short = int((grid.holds_to_mbar < top).sum())
    lines = [
        f"grid: {spec.geometry.aperture_mm:g} mm opening, {spec.geometry.thickness_mm:g} mm skin, "
        f"kappa {spec.kappa}"
    ]
    for name in ("X1_MPa", "X2_MPa", "nu", "pressure_mbar"):
        axis = getattr(spec, name)
        lines.append(f"  {name:<22}{axis[0]:g} to {axis[-1]:g}, {len(axis)} nodes")
    lines.append(f"{spec.entries} curves, {short} of them hold to less than {top:g} mbar")
    return lines


def _table(table: DimensionlessTable) -> list[str]:
    spec = table.spec
    lines = ["dimensionless: every aperture, thickness and pressure within"]
    for name in ("thickness_over_radius", "X2_over_X1", "kappa_over_X1"):
        axis = getattr(spec, name)
        lines.append(f"  {name:<22}{axis.low:g} to {axis.high:g}, {axis.nodes} nodes")
    lines.append(f"  {'X1_MPa':<22}{spec.X1_MPa[0]:g} to {spec.X1_MPa[1]:g}, exact")
    lines.append(f"  {'pressure_mbar':<22}0 to {spec.pressure_mbar:g}")
    median = float(np.median(table.holds_to_load))
    lines.append(
        f"{spec.entries} curves; half of them hold to p/X1 = {median:.3g} or more "
        f"({median * 0.025 / MBAR:.0f} mbar at X1 0.025 MPa)"
    )
    return lines
