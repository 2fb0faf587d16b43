"""The forward problem for users: from parameters and a program to a curve."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import Curve, Setup
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.settings import SAMPLES
from skinlab.errors import InputError, NotTrustworthyError
from skinlab.mechanics.effects.base import Effects
from skinlab.mechanics.effects.model import Sensors, going_on, is_physical
from skinlab.mechanics.fem.skin import Skin
from skinlab.mechanics.fem.suction import Geometry
from skinlab.mechanics.materials import LAWS
from skinlab.tables.base import Database
from skinlab.tables.evaluator import Evaluator
from skinlab.tables.table import Table

Array = NDArray[np.float64]

LEAST_CREASE = 0.011  # of the deflection: by so much a finer mesh's dome is higher at the crease


def simulate(
    skin: Skin,
    setup: Setup,
    rate_hz: float = 20.0,
    *,
    direct: bool = False,
    effects: Effects | None = None,
) -> tuple[Curve, str | None]:
    """Return the curve along the setup's program, and a warning where it creases or ends early.

    `direct` runs the finite elements, as physical effects always do; otherwise the shipped table
    answers. Beyond a crease at the tape's edge the finite elements go on with a blunter edge.

    Raises:
        InputError: a value is out of its range, or the shipped table is of another law.
        NotTrustworthyError: the model does not hold even for the first samples.
    """
    time_s, pressure = _asked(setup, rate_hz)
    effects = effects or {}
    assert setup.program is not None
    geometry = Geometry(setup.aperture_mm, setup.thickness_mm)
    path = PressurePath.of_program(setup.program)
    if not direct and not is_physical(effects):
        sensors = Sensors.of(effects)
        felt = path(sensors.when(time_s))
        deflection = _from_shipped(skin, geometry, felt)
        if np.isfinite(deflection).all():
            deflection = sensors.read(time_s, pressure, deflection, 0.0)
            return _as_far_as_it_holds(skin.law, setup, time_s, pressure, deflection)
    found = going_on(skin, effects, geometry, path, time_s, cycle=setup.cycle)
    if found.held.all() or int(np.argmin(found.held)) < SAMPLES.fewest or not found.moved_mm:
        own = np.where(found.held, found.deflection_mm, np.nan)
        return _as_far_as_it_holds(skin.law, setup, time_s, pressure, own)
    curve, ends = _as_far_as_it_holds(skin.law, setup, time_s, pressure, found.deflection_mm)
    error_um = 1e3 * max(abs(found.moved_mm), LEAST_CREASE * float(curve.deflection_mm.max()))
    warning = (
        f"crease: the surface creases at the tape's edge at {found.holds_to_mbar:.4g} mbar; beyond "
        f"that the curve is one with a blunter edge, good to about {error_um:.2g} µm"
    )
    return curve, warning if ends is None else f"{warning}; {ends}"


def simulate_from(
    table: Table,
    skin: Skin,
    effects: Effects,
    setup: Setup,
    rate_hz: float = 20.0,
) -> tuple[Curve, str | None]:
    """Return the curve that a table gives along the setup's program, and a warning if it ends.

    Of a table with effects, `effects` are those that differ from its model's own values.

    Raises:
        InputError: a value is out of its range, or none of the table's; or it is of another law.
        NotTrustworthyError: the table does not speak of it.
    """
    check_law_of(table, skin.law)
    time_s, pressure = _asked(setup, rate_hz)
    parameters = table.spec.point(skin.named, effects)
    covered = table.covers(Curve("simulated", setup, time_s, pressure, 0.0 * pressure))
    geometry = Geometry(setup.aperture_mm, setup.thickness_mm)
    outside = table.spec.space(table, skin.kappa).outside(parameters)
    if outside:
        raise InputError(outside)

    def model(samples: int) -> Evaluator:
        return table.model(geometry, pressure[:samples], skin.kappa, time_s=time_s[:samples])

    deflection = np.full(len(time_s), np.nan)
    there, holds = None, 0
    reach = len(covered) if covered.all() else int(covered.argmin())
    fails = 1 + reach
    while fails - holds > 1:  # the whole first, then halves: a part holds where more of it does
        samples = fails - 1 if holds == 0 and fails > len(time_s) else (holds + fails) // 2
        tried = model(samples)
        found = tried.deflection_mm(parameters[None])[0]
        if np.isfinite(found).all():
            deflection[:samples], there, holds = found, tried, samples
        else:
            fails = samples
    curve, ends = _as_far_as_it_holds(skin.law, setup, time_s, pressure, deflection, reach)
    if there is None or not there.creases(parameters[None])[0]:
        return curve, ends
    error_mm = np.linalg.norm(there.error_shapes_mm(parameters), axis=1).max()
    crease = (
        "crease: the surface creases at the tape's edge before the end; beyond that the curve is "
        f"one with a blunter edge, good to about {1e3 * error_mm:.2g} µm"
    )
    return curve, crease if ends is None else f"{crease}; {ends}"


def check_law_of(table: Database, law: str, what: str = "this database") -> None:
    """Refuse a table that is of another law.

    Raises:
        InputError: it is; names both.
    """
    if table.law != law:
        raise InputError(
            f"law {law}: {what} is of the law {table.law}; build one of yours "
            "(`skinlab database build --spec`) and name it with --database"
        )


def _asked(setup: Setup, rate_hz: float) -> tuple[Array, Array]:
    """Return times (n,) and pressures (n,) of the setup's program.

    Raises:
        InputError: a value is out of its range.
    """
    if setup.program is None:
        raise InputError("a simulated curve needs a program")
    if not (math.isfinite(rate_hz) and rate_hz > 0):
        raise InputError(f"rate_hz must be positive, got {rate_hz}")
    duration_s = setup.program.duration_s
    if duration_s * rate_hz > SAMPLES.most_simulated:
        raise InputError(
            f"rate_hz {rate_hz:g}: {duration_s * rate_hz:.0f} samples in the program's "
            f"{duration_s:g} s; expected at most {SAMPLES.most_simulated}, "
            f"{SAMPLES.most_simulated / duration_s:.0f} a second"
        )
    time_s = np.arange(math.floor(duration_s * rate_hz + 1e-9) + 1) / rate_hz
    return time_s, setup.program.pressure_mbar(time_s)


def _as_far_as_it_holds(
    law: str,
    setup: Setup,
    time_s: Array,
    pressure: Array,
    deflection: Array,
    reach: int | None = None,
) -> tuple[Curve, str | None]:
    """Return the curve up to where it has values, and a warning where that is not the end.

    `reach` are the samples that a database speaks of; None: there is none.
    """
    holds = np.isfinite(deflection)
    end = len(holds) if holds.all() else int(np.argmin(holds))
    warning = None
    if end < len(holds):
        who = LAWS.who(law)
        what = "the database" if end == reach else f"the model{f' of {who}' if who else ''}"
        highest = pressure[:end].max(initial=0.0)
        warning = f"{what} holds to {highest:.4g} mbar only; the curve ends there"
        if end < SAMPLES.fewest:
            raise NotTrustworthyError(warning)
    curve = Curve("simulated", setup, time_s[:end], pressure[:end], deflection[:end])
    return curve, warning


def _from_shipped(skin: Skin, geometry: Geometry, pressure: Array) -> Array:
    from skinlab.tables.store import shipped_table

    table, parameters = shipped_table(), np.array([skin.values])
    check_law_of(table, skin.law, "without --direct the shipped database answers, which")
    model = table.model(geometry, pressure, skin.kappa)
    outside = model.space.outside(parameters[0])
    if outside:
        raise InputError(f"{outside}; use --direct, or a value inside")
    setup = Setup(geometry.aperture_mm, geometry.thickness_mm)
    times = np.arange(len(pressure), dtype=float)
    if not table.covers(Curve("simulated", setup, times, pressure, 0.0 * pressure)).all():
        raise InputError(f"pressure {pressure.max():g} mbar is outside the database; use --direct")
    deflection = np.full(pressure.shape, np.nan)
    held = pressure <= model.holds_to(parameters)[0]
    if held.any():
        model = table.model(geometry, pressure[held], skin.kappa)
        deflection[held] = model.deflection_mm(parameters)[0]
    return deflection
