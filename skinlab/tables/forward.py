"""The forward problem for users: from parameters and a program to a curve."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import FEWEST_POINTS, Curve, Setup
from skinlab.curves.pressure_path import PressurePath
from skinlab.errors import InputError, NotTrustworthyError
from skinlab.mechanics.effects.model import Effects, Sensors, Skin, is_physical, response
from skinlab.mechanics.fem.suction import Geometry
from skinlab.mechanics.materials.compressibility import KappaConvention, kappa_ratio
from skinlab.parameters import contains
from skinlab.tables.base import Database
from skinlab.tables.model_database import ModelDatabase

Array = NDArray[np.float64]


def simulate(
    X1_MPa: float,
    X2_MPa: float,
    nu: float,
    setup: Setup,
    kappa: KappaConvention = "paper",
    rate_hz: float = 20.0,
    *,
    direct: bool = False,
    effects: Effects | None = None,
) -> tuple[Curve, str | None]:
    """Return the curve along the setup's program, and a warning where it had to end early.

    `direct` runs the finite elements, as physical effects always do; otherwise the shipped database
    answers.

    Raises:
        InputError: a value is out of its range.
        NotTrustworthyError: the model does not hold even for the first samples.
    """
    time_s, pressure = _asked(X1_MPa, X2_MPa, setup, rate_hz)
    effects = effects or {}
    assert setup.program is not None
    geometry = Geometry(setup.aperture_mm, setup.thickness_mm)
    kappa_ratio(nu, kappa)  # refuses a ν that cannot be
    path = PressurePath.of_program(setup.program)
    if direct or is_physical(effects):
        skin = Skin(X1_MPa, X2_MPa, nu, kappa)
        deflection = response(
            skin, effects, geometry, path, time_s, cycle=setup.cycle
        ).deflection_mm
    else:
        sensors = Sensors.of(effects)
        felt = path(sensors.when(time_s))
        deflection = _from_database(np.array([X1_MPa, X2_MPa, nu]), geometry, felt, kappa)
        deflection = sensors.read(time_s, deflection, 0.0)
    return _as_far_as_it_holds(setup, time_s, pressure, deflection)


def simulate_from(
    database: Database,
    base: Mapping[str, float],
    effects: Effects,
    setup: Setup,
    kappa: KappaConvention | None = None,
    rate_hz: float = 20.0,
) -> tuple[Curve, str | None]:
    """Return the curve that a database gives along the setup's program, and a warning if it ends.

    `base` are X1, X2 and ν by name. Of a database with effects, `effects` are those that differ
    from its model's own values; kappa None: the database's own.

    Raises:
        InputError: a value is out of its range, or none of the database's.
        NotTrustworthyError: the database does not speak of it.
    """
    time_s, pressure = _asked(base["X1_MPa"], base["X2_MPa"], setup, rate_hz)
    if isinstance(database, ModelDatabase):
        names, parameters = database.space.names, database.point(base, effects)
        kappa = kappa or database.spec.model.model.kappa
    elif effects:
        raise InputError("this database knows no effects; build one of the model")
    else:
        names, parameters = tuple(base), np.array(list(base.values()))
    covered = database.covers(Curve("simulated", setup, time_s, pressure, 0.0 * pressure))
    geometry = Geometry(setup.aperture_mm, setup.thickness_mm)

    def first(samples: int) -> Array:
        model = database.model(
            geometry, pressure[:samples], kappa or "paper", time_s=time_s[:samples]
        )
        inside = contains(model.space, parameters)
        if not inside:
            low, high = model.space.bounds
            said = zip(names, parameters, low, high, strict=True)
            ranges = ", ".join(f"{n} {v:g} ({a:.4g}–{b:.4g})" for n, v, a, b in said)
            raise InputError(f"outside the database, or at its edge: {ranges}")
        return np.asarray(model.deflection_mm(parameters[None])[0])

    deflection = np.full(len(time_s), np.nan)
    holds, fails = 0, 1 + (len(covered) if covered.all() else int(covered.argmin()))
    while fails - holds > 1:  # the whole first, then halves: a part holds where more of it does
        samples = fails - 1 if holds == 0 and fails > len(time_s) else (holds + fails) // 2
        found = first(samples)
        if np.isfinite(found).all():
            deflection[:samples], holds = found, samples
        else:
            fails = samples
    return _as_far_as_it_holds(setup, time_s, pressure, deflection)


def _asked(X1_MPa: float, X2_MPa: float, setup: Setup, rate_hz: float) -> tuple[Array, Array]:
    """Return times (n,) and pressures (n,) of the setup's program.

    Raises:
        InputError: a value is out of its range.
    """
    if setup.program is None:
        raise InputError("a simulated curve needs a program")
    for name, value in (("X1_MPa", X1_MPa), ("rate_hz", rate_hz)):
        if not (math.isfinite(value) and value > 0):
            raise InputError(f"{name} must be positive, got {value}")
    if not (math.isfinite(X2_MPa) and X2_MPa >= 0):
        raise InputError(f"X2_MPa must not be negative, got {X2_MPa}")
    time_s = np.arange(math.floor(setup.program.duration_s * rate_hz + 1e-9) + 1) / rate_hz
    return time_s, setup.program.pressure_mbar(time_s)


def _as_far_as_it_holds(
    setup: Setup, time_s: Array, pressure: Array, deflection: Array
) -> tuple[Curve, str | None]:
    """Return the curve up to where it has values, and a warning where that is not the end."""
    holds = np.isfinite(deflection)
    end = len(holds) if holds.all() else int(np.argmin(holds))
    warning = None
    if end < len(holds):
        warning = (
            f"the model holds to {pressure[:end].max(initial=0.0):.4g} mbar only; "
            f"the curve ends there"
        )
        if end < FEWEST_POINTS:
            raise NotTrustworthyError(warning)
    curve = Curve("simulated", setup, time_s[:end], pressure[:end], deflection[:end])
    return curve, warning


def _from_database(
    parameters: Array, geometry: Geometry, pressure: Array, kappa: KappaConvention
) -> Array:
    from skinlab.tables.store import shipped_table

    database = shipped_table()
    model = database.model(geometry, pressure, kappa)
    outside = model.range.outside(parameters)
    if outside:
        raise InputError(f"{outside}; use --direct, or a value inside")
    inside = database.covered(pressure)
    if not inside.all():
        top = database.spec.pressure_mbar
        raise InputError(
            f"pressure {pressure.max():g} mbar is outside the database (0–{top:g}); use --direct"
        )
    deflection = np.full(pressure.shape, np.nan)
    held = pressure <= model.holds_to_mbar(parameters[None])[0]
    if held.any():
        model = database.model(geometry, pressure[held], kappa)
        deflection[held] = model.deflection_mm(parameters[None])[0]
    return deflection
