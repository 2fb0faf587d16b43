"""The fitted curve, which a session does not store: the database at the stored parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinlab.curve import Curve
from skinlab.errors import InputError, NotTrustworthyError
from skinlab.identify.identifier import PAPERS_METHODS, Identifier
from skinlab.identify.noise import pressure_noise_mbar, slope_mm_per_mbar
from skinlab.identify.samples import choose, group
from skinlab.parameters import PAPER_BOX
from skinlab.report.stored import StoredResult

Array = NDArray[np.float64]

_LINE_POINTS = 200
_ROUNDING = 1e-3  # relative difference of a residual that another database or version explains


@dataclass(frozen=True, eq=False)
class Fit:
    """The model at the stored parameters: at the u samples that were fitted, and as a line."""

    mask: NDArray[np.bool_]  # (n,) of the curve's samples, which were fitted
    model_mm: Array  # (u,)
    residual_mm: Array  # (u,) measured less model
    noise_mm: Array | None  # (u,) one standard deviation, the pressure's noise included
    line_mbar: Array  # (m,) increasing
    line_mm: Array  # (m,)
    ranges: Mapping[str, tuple[float, float]]  # what was searched, by parameter
    remark: str = ""  # a sentence where this is not quite what was found then

    @property
    def within(self) -> float | None:
        """Share of the residuals inside two standard deviations of the noise; None: unknown."""
        if self.noise_mm is None:
            return None
        return float(np.mean(np.abs(self.residual_mm) <= 2.0 * self.noise_mm))


def fit_again(curve: Curve, result: StoredResult, identifier: Identifier) -> Fit:
    """Return the fit that was found then; nothing is identified again.

    Raises:
        InputError: the database of this installation cannot give it; says why in a sentence.
    """
    values = result.parameters or {}
    if set(values) != {"X1_MPa", "X2_MPa", "nu"}:
        raise InputError("its parameters are not those of the base model")
    x = np.array([[values[name].value for name in ("X1_MPa", "X2_MPa", "nu")]])
    database, kappa = identifier.database, identifier.kappa
    try:
        chosen = choose(curve, result.phases or identifier.phases, database)
        (members,) = group([chosen])
        model = members.model(database, kappa)
        model_mm = model.deflection_mm(x)[0]
        line_mbar = np.linspace(
            members.pressure_mbar.min(), members.pressure_mbar.max(), _LINE_POINTS
        )
        line_mm = database.model(members.geometry, line_mbar, kappa).deflection_mm(x)[0]
    except NotTrustworthyError as error:
        raise InputError(str(error)) from None
    if not np.isfinite(model_mm).all():
        raise InputError("the database does not hold at the stored parameters")
    residual_mm = members.deflection_mm - model_mm
    space = PAPER_BOX if identifier.method in PAPERS_METHODS else model.space
    lows, highs = (bound.tolist() for bound in space.bounds)
    return Fit(
        mask=chosen.mask,
        model_mm=model_mm,
        residual_mm=residual_mm,
        noise_mm=_noise_mm(curve, chosen.mask, model_mm, result, identifier),
        line_mbar=line_mbar,
        line_mm=line_mm,
        ranges=dict(zip(space.names, zip(lows, highs, strict=True), strict=True)),
        remark=_remark(residual_mm, result),
    )


def _noise_mm(
    curve: Curve,
    mask: NDArray[np.bool_],
    model_mm: Array,
    result: StoredResult,
    identifier: Identifier,
) -> Array | None:
    if result.noise_um is None:
        return None
    stated = identifier.sensor.pressure_noise_mbar
    pressure = curve.pressure_mbar[mask]
    spread = pressure_noise_mbar(curve.time_s[mask], pressure) if stated is None else stated
    return np.hypot(1e-3 * result.noise_um, slope_mm_per_mbar(pressure, model_mm) * spread)


def _remark(residual_mm: Array, result: StoredResult) -> str:
    if result.rms_um is None:
        return ""
    now_um = 1e3 * float(np.sqrt(np.mean(residual_mm**2)))
    if abs(now_um - result.rms_um) <= _ROUNDING * max(result.rms_um, 1.0):
        return ""
    return (
        f"The fitted curve was computed again for this report and leaves {now_um:.3g} µm, where "
        f"{result.rms_um:.3g} µm is stored: the database or the program differs from then."
    )
