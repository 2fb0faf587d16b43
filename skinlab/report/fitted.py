"""The fitted curve, which a session does not store: the model at the stored parameters."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.campaign import Campaign
from skinlab.curves.corrected import as_read
from skinlab.curves.curve import Curve
from skinlab.discrepancy.misfit import errors_of
from skinlab.discrepancy.records import records_of
from skinlab.errors import InputError, NotTrustworthyError
from skinlab.inference.identify import Identifier
from skinlab.inference.methods import get_method
from skinlab.inference.noise import sample_sd_mm
from skinlab.inference.samples import Fitted, choose, group
from skinlab.inference.stored_results import StoredResult
from skinlab.mechanics.effects import get_effect
from skinlab.mechanics.effects.model import response
from skinlab.mechanics.fem.skin import Skin
from skinlab.mechanics.model_file import Model

Array = NDArray[np.float64]

_LINE_POINTS = 200
# Relative difference of a residual from where on the database or the program is another
_ROUNDING = 1e-3
# The same of a model with effects: it was fitted by the database where that tells them, with the
# noise of pressures that an earlier fit took off. Here the finite elements answer, at the readings.
_ROUNDING_OF_EFFECTS = 1e-2


@dataclass(frozen=True, eq=False)
class Fit:
    """The model at the stored parameters: at the u samples that were fitted, and as a line."""

    mask: NDArray[np.bool_]  # (n,) of the curve's samples, which were fitted
    model_mm: Array  # (u,)
    residual_mm: Array  # (u,) measured less model
    noise_mm: Array | None  # (u,) one standard deviation, the pressure's noise included
    line_mbar: Array  # (m,) increasing, or in the order of time where the model has a memory
    line_mm: Array  # (m,)
    ranges: Mapping[str, tuple[float, float]]  # what was searched, by parameter, where known
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
        InputError: this installation cannot compute it; says why in a sentence.
    """
    try:
        (curve,) = identifier.corrected([curve])
        chosen = choose(
            curve,
            result.phases or identifier.phases,
            identifier.database,
            most_samples=get_method(identifier.method).most_fitted,
        )
        chosen.mask[[i for i in result.outliers if 0 <= i < len(curve)]] = False
        make = _with_effects if identifier.model.effects else _from_database
        at = make(chosen, result, identifier)
    except NotTrustworthyError as error:
        raise InputError(str(error)) from None
    if not np.isfinite(at.model_mm).all():
        raise InputError("the model does not hold at the stored parameters")
    residual_mm = curve.deflection_mm[chosen.mask] - at.model_mm
    _, model_mm = as_read(curve, curve.pressure_mbar[chosen.mask], at.model_mm)
    line_mbar, line_mm = as_read(curve, at.line_mbar, at.line_mm)
    return Fit(
        mask=chosen.mask,
        model_mm=model_mm,
        residual_mm=residual_mm,
        noise_mm=at.noise_mm,
        line_mbar=line_mbar,
        line_mm=line_mm,
        ranges=at.ranges,
        remark=_remark(residual_mm, result, at.rounding),
    )


@dataclass(frozen=True, eq=False)
class _Model:
    model_mm: Array  # (u,)
    noise_mm: Array | None  # (u,)
    line_mbar: Array  # (m,)
    line_mm: Array  # (m,)
    ranges: Mapping[str, tuple[float, float]]
    rounding: float = _ROUNDING


def _from_database(chosen: Fitted, result: StoredResult, identifier: Identifier) -> _Model:
    values = result.parameters or {}
    best = result.optimum or {name: value.value for name, value in values.items()}
    database, kappa = identifier.database, identifier.kappa
    (members,) = group([chosen])
    model = members.model(database, kappa)
    names = model.space.names
    if set(values) != set(names):
        raise InputError("its parameters are not those of the database")
    x = np.array([[best[name] for name in names]])
    line_mbar = np.linspace(members.pressure_mbar.min(), members.pressure_mbar.max(), _LINE_POINTS)
    space = identifier.space_of(model)
    lows, highs = (bound.tolist() for bound in space.bounds)
    model_mm = model.deflection_mm(x)[0]
    return _Model(
        model_mm,
        _noise_mm(chosen, model_mm, result, identifier),
        line_mbar,
        database.model(members.geometry, line_mbar, kappa).deflection_mm(x)[0],
        dict(zip(space.names, zip(lows, highs, strict=True), strict=True)),
    )


def _with_effects(chosen: Fitted, result: StoredResult, identifier: Identifier) -> _Model:
    values = result.optimum or {n: value.value for n, value in (result.parameters or {}).items()}
    law = identifier.model.law
    if not set(law.names) <= set(values):
        raise InputError("its parameters are not those of its model")
    effects = {
        effect: {name: known.value for name, known in parameters.items()}
        for effect, parameters in identifier.model.effects.items()
    }
    for name, value in values.items():
        effect, _, parameter = name.rpartition(".")
        if effect:  # of the model, or an uncertain thickness
            effects.setdefault(effect, {})[parameter] = value
    fitted = chosen.samples
    sensor = identifier.sensor
    (record,) = records_of(Campaign("", sensor.noise_um, sensor.pressure_noise_mbar, (fitted,)))
    skin = Skin(tuple(values[name] for name in law.names), identifier.kappa, law.name)
    model_mm = response(
        skin,
        effects,
        record.geometry,
        record.path,
        fitted.time_s,
        record.pressure_mbar,
        cycle=fitted.setup.cycle,
    ).deflection_mm
    noise_mm = errors_of([record]).sigma_mm
    return _Model(
        model_mm,
        noise_mm,
        record.pressure_mbar,
        model_mm,
        _ranges(identifier.model, effects),
        _ROUNDING_OF_EFFECTS,
    )


def _ranges(model: Model, effects: Iterable[str]) -> dict[str, tuple[float, float]]:
    """Return where a fit with effects searches."""
    low, high = (bound.tolist() for bound in model.space.bounds)
    found = dict(zip(model.space.names, zip(low, high, strict=True), strict=True))
    for effect in effects:
        for parameter in get_effect(effect).parameters:
            found[f"{effect}.{parameter.name}"] = (parameter.low, parameter.high)
    return found


def _noise_mm(
    chosen: Fitted, model_mm: Array, result: StoredResult, identifier: Identifier
) -> Array | None:
    if result.noise_um is None:
        return None
    time, pressure = chosen.curve.time_s[chosen.mask], chosen.curve.pressure_mbar[chosen.mask]
    stated = identifier.sensor.pressure_noise_mbar
    return sample_sd_mm(time, pressure, model_mm, result.noise_um, stated)


def _remark(residual_mm: Array, result: StoredResult, rounding: float) -> str:
    if result.rms_um is None:
        return ""
    now_um = 1e3 * float(np.sqrt(np.mean(residual_mm**2)))
    if abs(now_um - result.rms_um) <= rounding * max(result.rms_um, 1.0):
        return ""
    return (
        f"The fitted curve was computed again for this report and leaves {now_um:.3g} µm, where "
        f"{result.rms_um:.3g} µm is stored: the database or the program differs from then."
    )
