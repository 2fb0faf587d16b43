"""What to measure next, to tell tied explanations apart."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import Curve, Setup
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.program import parse_program
from skinlab.discrepancy.fit import Fit, Fitter
from skinlab.discrepancy.misfit import errors_of
from skinlab.discrepancy.records import Record
from skinlab.discrepancy.space_mapping import MappedModel
from skinlab.mechanics.fem.suction import Geometry

Array = NDArray[np.float64]

# To suctions at which skins dome about alike: beyond, they crease, and two meshes differ by more
# than is counted with.
_TOPS_MBAR = {2.0: 400, 4.0: 200, 6.0: 100, 8.0: 100}
_SLOW_S = 25  # up, and again down: suction without a pause may last 60 s, and samples tell
MENU = tuple(
    (aperture, program)
    for aperture, top in _TOPS_MBAR.items()
    for program in (
        f"ramp:{top}@60,ramp:0@60",
        f"ramp:{top}@80,hold:20,ramp:0@80,hold:8",
        f"ramp:{top}@{top // _SLOW_S},ramp:0@{top // _SLOW_S}",
    )
)
_RATE_HZ = 20.0
_STEP = 0.05
_USELESS = 0.3  # log10 evidence: less tells nothing


@dataclass(frozen=True)
class NextMeasurement:
    """A measurement, which explanations it separates, and by how much evidence it may be hoped."""

    aperture_mm: float
    program: str
    separates: tuple[tuple[str, ...], ...]
    expected_log10_evidence: float


def advise(fitter: Fitter, tied: Sequence[Fit]) -> NextMeasurement | None:
    """Return the measurement of the menu that best separates the closest two, None if none does.

    Between two explanations it expects half the squared length of the difference of their curves,
    whitened, what either's unknowns may still give way by counted as an error (linearised).
    """
    best: NextMeasurement | None = None
    have = {(r.geometry.aperture_mm, str(r.curve.setup.program or "")) for r in fitter.records}
    for aperture, program in MENU:
        if (aperture, program) in have and len(MENU) > len(have):
            continue
        record = _planned(fitter, aperture, program)
        looks = [_look(fitter, fit, record) for fit in tied]
        if any(look is None for look in looks):
            continue
        errors = errors_of([replace(record, curve=_with(record, looks[0][0]))])  # type: ignore[index]
        expected = math.inf
        for one, other in combinations([x for x in looks if x is not None], 2):
            difference = errors.whiten(one[0] - other[0])
            doubt = np.hstack([errors.whiten(one[1]), errors.whiten(other[1])])
            inner = np.eye(doubt.shape[1]) + doubt.T @ doubt
            across = doubt.T @ difference
            chi2 = float(difference @ difference - across @ np.linalg.solve(inner, across))
            expected = min(expected, 0.5 * chi2 / math.log(10.0))
        if expected > max(_USELESS, best.expected_log10_evidence if best else 0.0):
            best = NextMeasurement(
                aperture, program, tuple(fit.effects for fit in tied), float(expected)
            )
    return best


def _planned(fitter: Fitter, aperture: float, program_text: str) -> Record:
    """Return a record that was not measured, with the campaign's noise."""
    like = fitter.records[0]
    program = parse_program(program_text)
    samples = math.floor(program.duration_s * _RATE_HZ) + 1
    time = np.arange(samples) / _RATE_HZ
    path = PressurePath.of_program(program)
    setup = Setup(aperture, like.geometry.thickness_mm, program)
    pressure = path(time)
    curve = Curve(f"planned, {aperture:g} mm", setup, time, pressure, np.zeros(samples))
    geometry = Geometry(aperture, like.geometry.thickness_mm)
    return Record(curve, geometry, path, pressure, like.pressure_sd_mbar, like.noise_um)


def _with(record: Record, deflection_mm: Array) -> Curve:
    curve = record.curve
    return Curve(curve.name, curve.setup, curve.time_s, curve.pressure_mbar, deflection_mm)


def _look(fitter: Fitter, fit: Fit, record: Record) -> tuple[Array, Array] | None:
    """Return the curve expected (n,), and how it gives way (n, k), a standard deviation each."""
    model = MappedModel([record], fit.unknowns, fitter.domes)
    if not model.anchor(fit.u):
        return None
    curve = model.predict(fit.u)[0]
    if not np.isfinite(curve).all():
        return None
    root = np.linalg.cholesky(np.linalg.inv(fit.information))
    columns = []
    low, high = fit.unknowns.bounds
    for j in range(len(fit.u)):
        # Along a direction of the posterior, but no further than the model is trusted.
        along = _STEP * root[:, j] / max(float(np.abs(root[:, j]).max()), 1e-12)
        along = np.clip(fit.u + along, low, high) - fit.u
        length = float(np.abs(along).max())
        if length < 1e-9:
            columns.append(np.zeros(len(curve)))
            continue
        moved = model.predict(fit.u + along)[0]
        columns.append((moved - curve) * float(np.abs(root[:, j]).max()) / _STEP)
    slopes = np.nan_to_num(np.column_stack(columns))
    return curve, slopes
