"""Curves without what their probe reads wrong, as far as its calibration knows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import Curve
from skinlab.curves.probe_file import PARAMETERS, ProbeErrors, pressure_rate
from skinlab.errors import InputError

Array = NDArray[np.float64]


def corrected(curve: Curve, probe: ProbeErrors) -> Curve:
    """Return a curve of true pressures and deflections, as far as they are known.

    Raises:
        InputError: it is of another opening.
    """
    file, t = probe.file, curve.time_s
    if curve.setup.aperture_mm != file.aperture_mm:
        raise InputError(
            f"{curve.name}: aperture_mm {curve.setup.aperture_mm:g}; the probe file is of "
            f"{file.aperture_mm:g} mm"
        )
    # Not read between samples, which would average their noise and make it last
    felt = curve.pressure_mbar - file.lag_s.value * pressure_rate(t, curve.pressure_mbar)
    pressure = (felt - file.pressure_offset_mbar.value) / file.pressure_gain.value
    deflection = curve.deflection_mm - 1e-3 * file.deflection_offset_um.value
    return replace(
        curve,
        pressure_mbar=pressure,
        deflection_mm=deflection / file.deflection_gain.value,
        probe=None,
        corrected_by=probe,
    )


def as_read(curve: Curve, pressure_mbar: Array, deflection_mm: Array) -> tuple[Array, Array]:
    """Return what the probe of a corrected curve reads of true pressures and deflections (n,)."""
    if curve.corrected_by is None:
        return pressure_mbar, deflection_mm
    file = curve.corrected_by.file
    return (
        file.pressure_gain.value * pressure_mbar + file.pressure_offset_mbar.value,
        file.deflection_gain.value * deflection_mm + 1e-3 * file.deflection_offset_um.value,
    )


def columns_of(
    curves: Sequence[Curve], pressure_mbar: Array, deflection_mm: Array, slope_mm_per_mbar: Array
) -> Array:
    """Return what the calibrations of curves leave open, as columns (u, m) of errors in mm.

    For the pressures, deflections and dw/dp (u,) of a model, of all samples, end to end; curves of
    one probe err alike. Readings of the pressure would have their noise in the columns.
    """
    probes = {c.corrected_by.hash: c.corrected_by for c in curves if c.corrected_by is not None}
    ends = np.cumsum([len(c) for c in curves])[:-1]
    each = (np.split(x, ends) for x in (pressure_mbar, deflection_mm, slope_mm_per_mbar))
    parts = list(zip(*each, strict=True))
    blocks = [np.zeros((len(deflection_mm), 0))]
    for hashed, probe in probes.items():
        rows = [
            probe.columns_mm(c.time_s, *part)
            if c.corrected_by is not None and c.corrected_by.hash == hashed
            else np.zeros((len(c), len(PARAMETERS)))
            for c, part in zip(curves, parts, strict=True)
        ]
        blocks.append(np.vstack(rows))
    return np.hstack(blocks)
