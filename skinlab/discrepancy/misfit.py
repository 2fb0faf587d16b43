"""The covariance of the errors of a campaign's samples."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skinlab.curves import corrected
from skinlab.discrepancy.records import Record, by_geometry
from skinlab.inference.covariance import Covariance
from skinlab.inference.noise import (
    MESH_REST,
    legendre,
    pressure_error_mm,
    slope_mm_per_mbar,
    smooth_mm,
)
from skinlab.tables.model_errors import crease_shapes

Array = NDArray[np.float64]

# Relative deviation of the mesh of record from a fine one, by orders of shifted Legendre
# polynomials of p/p_max: what the openings of one skin have in common, and each one's own, root
# mean squares (`python benchmarks/model_error.py --openings`).
MESH_COMMON = (3.4e-4, 2.1e-4, 1.3e-4, 6.1e-5, 4.4e-5, 2.9e-5, 1.9e-5, 1.3e-5)
MESH_OWN = (6.0e-4, 1.7e-4, 8.8e-5, 4.9e-5, 2.9e-5, 2.3e-5, 1.8e-5, 1.2e-5)
# Another program deviates more, but at all openings alike: at the tops of eleven skins 0.15 % in
# common and 0.025 % apart, where a fine mesh of ours does 0.063 and 0.073 % (the same command).
COMMON_FACTOR = 2.4
OWN_FACTOR = 0.5


def errors_of(records: Sequence[Record]) -> Covariance:
    """Return the errors: noise, pressure noise through dw/dp, and the discretisation's shapes."""
    noise_mm = np.concatenate([r.each(1e-3 * r.noise_um) for r in records])
    w = np.concatenate([r.curve.deflection_mm for r in records])
    variance = noise_mm**2 + pressure_errors_mm(records) ** 2 + (MESH_REST * w) ** 2
    ends = tuple(int(v) for v in np.cumsum([len(r.curve) for r in records]))
    return Covariance(variance, columns_of(records), ends)


def columns_of(records: Sequence[Record]) -> Array:
    """Return the shapes (u, m), mm, in which all samples err: the mesh's, and the probe's."""
    w = np.concatenate(_smoothed(records))
    curves, pressure = (
        [r.curve for r in records],
        np.concatenate([r.pressure_mbar for r in records]),
    )
    left_open = corrected.columns_of(curves, pressure, w, slopes_mm_per_mbar(records))
    return np.hstack([mesh_columns(records), left_open])


def _smoothed(records: Sequence[Record]) -> list[Array]:
    """Return each record's deflections without their noise, which shapes of it would explain.

    Shapes of opposite signs take off a share of every reading: of 4,000 samples' noise that is 270
    in chi2 (docs/decisions/0128-shapes-without-noise.md).
    """
    return [smooth_mm(r.pressure_mbar, r.curve.deflection_mm) for r in records]


def slopes_mm_per_mbar(records: Sequence[Record]) -> Array:
    """Return dw/dp (u,) of the measured curves."""
    return np.concatenate(
        [slope_mm_per_mbar(r.pressure_mbar, r.curve.deflection_mm) for r in records]
    )


def pressure_errors_mm(
    records: Sequence[Record], deflections_mm: Sequence[Array] | None = None
) -> Array:
    """Return what the pressure readings' noise does to the deflections (u,), measured or these."""
    if deflections_mm is None:
        deflections_mm = [r.curve.deflection_mm for r in records]
    found = []
    for r, w in zip(records, deflections_mm, strict=True):
        found.append(pressure_error_mm(r.pressure_mbar, w, r.each(r.pressure_sd_mbar)))
    return np.concatenate(found)


def mesh_columns(records: Sequence[Record]) -> Array:
    """Return the shapes (u, m), mm, in which the discretisation errs."""
    blocks = []
    starts = np.cumsum([0, *(len(r.curve) for r in records)])
    total = int(starts[-1])
    orders = len(MESH_OWN)
    smooth = _smoothed(records)
    common = np.zeros((total, orders))
    for members in by_geometry(records):
        block = np.zeros((total, orders))
        top = max(1e-9, *(float(records[i].pressure_mbar.max()) for i in members))
        for i in members:
            x = np.clip(records[i].pressure_mbar / top, 0.0, 1.0)
            shapes = legendre(x, orders) * smooth[i][:, None]
            here = slice(starts[i], starts[i + 1])
            block[here] = OWN_FACTOR * np.array(MESH_OWN) * shapes
            common[here] = COMMON_FACTOR * np.array(MESH_COMMON) * shapes
        blocks.append(block)
    return np.hstack([*blocks, common, *_of_the_table(records, smooth, starts)])


def _of_the_table(
    records: Sequence[Record], smooth: Sequence[Array], starts: NDArray[np.intp]
) -> list[Array]:
    """Return shapes (u, m) of each opening, mm, in which meshes differ on the way to a crease.

    And those in which a table errs between its nodes: both as an identification counts with them
    (docs/decisions/0022-going-on-near-creases.md).
    """
    found = []
    for members in by_geometry(records):
        share = np.concatenate(
            [records[i].pressure_mbar / records[i].creases_mbar for i in members]
        )
        deflection_mm = np.concatenate([smooth[i] for i in members])
        shapes = crease_shapes(share)
        if (seen := records[members[0]].table_errors) is not None:
            pressure = np.concatenate([records[i].pressure_mbar for i in members])
            shapes = np.hstack([shapes, seen.shapes(pressure)])
        shapes = shapes * deflection_mm[:, None]
        block = np.zeros((int(starts[-1]), shapes.shape[1]))
        block[np.concatenate([np.arange(starts[i], starts[i + 1]) for i in members])] = shapes
        found.append(block[:, block.any(axis=0)])
    return found
