"""The forward model with effects, fast: the database, and finite elements where it cannot speak.

A skin's problem has features that the dimensionless table answers exactly (other stiffness, other
thickness, a preload), and others (layers, pre-stretch, slip, added energy, relaxation) that it does
not. For these the finite elements are solved at one point, the anchor, and their ratio to the
table's answer there corrects the table nearby; the ratio's change with the unknowns is taken from
differences or learnt from anchor to anchor. At the anchor itself the model is that of the finite
elements (space mapping: Bandler et al. 2004, IEEE Trans. Microw. Theory Tech. 52:337). Relaxation
is first approximated by letting the pressure of the dome relax as the stress would.

Nothing here asks which effect it is.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.pressure_path import PressurePath
from skinlab.errors import NotTrustworthyError
from skinlab.mechanics.fem.skin import Prony, SkinProblem
from skinlab.mechanics.fem.suction import Geometry
from skinlab.mechanics.materials.compressibility import KappaConvention
from skinlab.tables.base import CurveModel, Database

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

Array = NDArray[np.float64]

_NODES = 72
_BELOW_MBAR = 12.0  # under zero, for noise and for lag
_RATIO_SD = 0.13  # thickness from 0.55 to 1.45 of the stated one
# The highest suctions (mbar) that the database is tabulated to: few, so that these are kept.
_TOPS = (*(20.0 * 1.2**i for i in range(18)), 505.0)
_LEAST_REACH = 0.5  # of the suction that is asked for: a skin that creases before has no dome


@dataclass(frozen=True, eq=False)
class Dome:
    """Deflection (mm) as a function of suction (mbar); straight lines beyond its ends."""

    spline: PPoly
    scale: float

    def __call__(self, pressure_mbar: Array) -> Array:
        """Return the deflection at these suctions."""
        s = self.spline
        low, high = (self.scale * math.sinh(x) for x in (s.x[0], s.x[-1]))
        within = np.clip(pressure_mbar, low, high)
        at = np.arcsinh(within / self.scale)
        found = s(at)
        beyond = pressure_mbar - within
        if beyond.any():
            found = found + beyond * s(at, 1) / np.hypot(within, self.scale)
        return np.asarray(found)


@dataclass(frozen=True, eq=False)
class _Tabulated:
    """The database at a geometry, at the nodes of a spline in arsinh(p / scale)."""

    model: CurveModel
    nodes: Array
    scale: float
    spline_of: Array  # (4, n − 1, n): the spline's coefficients, of values at the nodes

    def dome(self, parameters: Array, least_reach_mbar: float) -> Dome | None:
        """Return the dome of parameters (1, p), None where the table does not hold so far.

        Beyond where the skin creases it goes on as the table was filled, smoothly in the
        parameters too: a dome that ended there would put stairs into every misfit.
        """
        values, reach_mbar = self.model.with_reach(parameters)
        if reach_mbar[0] < least_reach_mbar or not np.isfinite(values).all():
            return None
        from scipy.interpolate import PPoly  # slow to import

        spline = PPoly.construct_fast(self.spline_of @ values[0], self.nodes)
        return Dome(spline, self.scale)


def _tabulate(
    database: Database, geometry: Geometry, top_mbar: float, kappa: KappaConvention, sd_mm: float
) -> _Tabulated:
    scale = top_mbar / 40.0
    low, high = math.asinh(-_BELOW_MBAR / scale), math.asinh(top_mbar / scale)
    nodes = np.linspace(low, high, _NODES)
    pressure = scale * np.sinh(nodes)
    model = database.model(geometry, pressure, kappa, sd_mm)
    from scipy.interpolate import CubicSpline  # slow to import

    return _Tabulated(model, nodes, scale, CubicSpline(nodes, np.eye(_NODES)).c)


_plain = lru_cache(maxsize=64)(_tabulate)  # 7 MB each
_any_thickness = lru_cache(maxsize=16)(_tabulate)  # 75 MB each


class TableDomes:
    """Domes from the dimensionless table: any stiffness, any thickness near the stated one."""

    def __init__(self, database: Database) -> None:
        """Keep the database; models are made when first asked for, and kept."""
        self._database = database

    def __call__(self, problem: SkinProblem, stated: Geometry, top_mbar: float) -> Dome | None:
        """Return the dome of a problem's plain part, or None where the table does not hold.

        Features that it cannot speak of are left out; `top_mbar` is the highest suction asked for.
        """
        # Lengths have no scale of their own: a wider opening is a thinner skin, drawn larger.
        wider = problem.geometry.aperture_mm / stated.aperture_mm
        ratio = problem.geometry.thickness_mm / stated.thickness_mm / wider
        free = abs(ratio - 1.0) > 1e-12
        parameters = np.array([[*problem.skin.values, *([ratio] if free else [])]])
        tabulated = _any_thickness if free else _plain
        sd_mm = _RATIO_SD * stated.thickness_mm if free else 0.0
        top = _TOPS[min(bisect_left(_TOPS, top_mbar), len(_TOPS) - 1)]
        try:
            found = tabulated(self._database, stated, top, problem.skin.kappa, sd_mm)
        except NotTrustworthyError:
            return None
        dome = found.dome(parameters, _LEAST_REACH * min(top_mbar, top))
        if dome is None or wider == 1.0:
            return dome
        s = dome.spline
        return Dome(type(s).construct_fast(wider * s.c, s.x), dome.scale)


def relaxed_pressure(
    prony: tuple[Prony, ...], path: PressurePath, time_s: Array, preload_mbar: float
) -> tuple[Array, float]:
    """Return the suctions (n,) without memory that would dome the skin as memory does, at times.

    As if the dome's answer P(w) relaxed like the stress: p = (1 − Σg) P + Σ g H, dH/dt + H/τ =
    dP/dt. The second value is that of the relaxed preload. In closed form, since the path is made
    of straight lines: dH/dt = −A H + dp/dt with A = (I − 1 gᵀ) diag(1/τ).
    """
    g = np.array([term.g for term in prony])
    tau = np.array([term.tau_s for term in prony])
    rest = 1.0 - float(g.sum())
    start = preload_mbar / rest
    rates, vectors = np.linalg.eig((np.eye(len(g)) - g[None, :]) / tau)
    # gᵀ H is a sum of modes, each of which forgets at a rate of its own.
    modes = np.real(g @ vectors * np.linalg.solve(vectors, np.ones(len(g))))
    t, p = np.array(path.time_s), np.array(path.pressure_mbar)
    since = np.maximum(time_s[:, None] - t, 0.0)  # (n, knots)
    length, rise = np.diff(t), np.diff(p)
    slope = np.divide(rise, length, out=np.zeros_like(rise), where=length > 0)
    jump = np.concatenate([p[:1], np.where(length > 0, 0.0, rise)])  # the first from zero
    held = np.zeros(len(time_s))
    for rate, mode in zip(np.real(rates), modes, strict=True):
        left = np.exp(-rate * since)
        jumped = np.where(time_s[:, None] >= t, left, 0.0) @ jump
        held += mode * (jumped + (left[:, 1:] - left[:, :-1]) @ slope / rate)
    return np.asarray(start + (path(time_s) - held) / rest), start


def plain_part(problem: SkinProblem) -> SkinProblem:
    """Return the problem as the table can answer it."""
    return replace(
        problem, terms=(), above=(), below=(), stretch=1.0, slip_mm=0.0, prony=(), preload_mbar=0.0,
        stiffness=1.0,
    )  # fmt: skip


def has_features(problem: SkinProblem) -> bool:
    """Return whether the finite elements have to correct the table, relaxation apart."""
    return replace(plain_part(problem), stiffness=problem.stiffness) != replace(
        problem, prony=(), preload_mbar=0.0
    )
