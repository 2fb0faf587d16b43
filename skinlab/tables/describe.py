"""What is in a database, in a few lines."""

from __future__ import annotations

import numpy as np

from skinlab.mechanics.fem.suction import MBAR
from skinlab.tables.dimensionless import DimensionlessTable
from skinlab.tables.grid import GridDatabase
from skinlab.tables.model_database import ModelDatabase


def describe(database: GridDatabase | DimensionlessTable | ModelDatabase) -> str:
    """Return the text."""
    head = (
        f"law {database.law}, mesh {database.mesh_name}, solver version {database.solver_version}"
    )
    if isinstance(database, ModelDatabase):
        lines = _model(database)
    else:
        lines = _grid(database) if isinstance(database, GridDatabase) else _table(database)
    return "\n".join([head, *lines, database.content_hash])


def _model(database: ModelDatabase) -> list[str]:
    spec = database.spec
    model, course = spec.model, database.course
    lines = [
        f"model {model.model.name!r} ({model.hash[:19]}…), kappa {model.model.kappa}: "
        f"{spec.geometry.aperture_mm:g} mm opening, {spec.geometry.thickness_mm:g} mm skin"
    ]
    if spec.has_history:
        lines.append(f"  along {spec.program} only, cycle {spec.measurement.cycle}")
    for name, axis in spec.axis.items():
        lines.append(
            f"  {name:<28}{axis.low:g} to {axis.high:g}, {axis.nodes} nodes, {axis.spacing}"
        )
    for effect, values in model.values.items():
        for parameter, value in values.items():
            if f"{effect}.{parameter}" not in spec.axis:
                lines.append(f"  {effect}.{parameter} is {value:g}")
    lines.append(f"  {'pressure_mbar':<28}0 to {spec.high_mbar:g}, {len(course.nodes)} samples")
    short = int((database.holds_to < course.nodes[-1]).sum())
    lines.append(f"{spec.entries} curves, {short} of them hold to less than the end")
    rms_um = 1e3 * np.sqrt(np.mean(database.errors[:, : len(course.nodes)] ** 2, axis=1))
    lines.append(
        f"between the nodes off by {np.median(rms_um):.2g} µm rms, at worst {rms_um.max():.2g} µm "
        f"({len(rms_um)} points compared with finite elements)"
    )
    said = model.provenance
    if said.verdict:
        origin = f", from {', '.join(said.data)}" if said.data else ""
        lines.append(f"adopted {said.date}, verdict {said.verdict}{origin}")
    built = ", ".join(f"{name} {v}" for name, v in sorted(database.versions.items()))
    return [*lines, f"built with {built}"]


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
