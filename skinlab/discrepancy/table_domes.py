"""Domes from the dimensionless table, and suctions that dome a skin as its memory does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.pressure_path import PressurePath
from skinlab.discrepancy.settings import FITS
from skinlab.mechanics.fem import kernel
from skinlab.mechanics.fem.skin import Prony, SkinProblem
from skinlab.mechanics.fem.suction import MBAR
from skinlab.tables.base import Database
from skinlab.tables.model_errors import SeenErrors

Array = NDArray[np.float64]

_NODES = 72
_BELOW_MBAR = 12.0  # under zero, for noise and for lag
_HIGHEST_MBAR = 505.0  # that the database is asked for
_BEND = 40.0  # the scale of the splines' arsinh is so much below their end


@dataclass(frozen=True, eq=False)
class Domes:
    """Deflections (mm) as functions of suction (mbar): cubic splines in arsinh(p / scale).

    Of n skins at once; straight lines beyond the ends. Where there is no dome all is NaN.
    """

    coefficients: Array  # (n, nodes − 1, 4), by the distance from a node in steps
    scale_mbar: Array  # (n,)
    begin: Array  # (n,) arsinh at the first node
    step: Array  # (n,)

    def __len__(self) -> int:
        return len(self.scale_mbar)

    @property
    def hold(self) -> NDArray[np.bool_]:
        """Which of them there are (n,)."""
        return np.asarray(np.isfinite(self.coefficients[:, 0, 0]))

    @cached_property
    def _alike(self) -> bool:
        """Whether all of them have their nodes at the same suctions."""
        each = (self.scale_mbar, self.begin, self.step)
        return all(bool((v == v[0]).all()) for v in each)

    def some(self, rows: slice) -> Domes:
        """Return some of them."""
        return Domes(
            self.coefficients[rows], self.scale_mbar[rows], self.begin[rows], self.step[rows]
        )

    def __call__(self, pressure_mbar: Array) -> Array:
        """Return the deflections (n, m) at suctions (n, m), or (1, m) for all."""
        parts = self.coefficients, self.scale_mbar, self.begin, self.step
        compiled = kernel.domes(parts, pressure_mbar, alike=self._alike)
        if compiled is not None:
            return compiled
        n, cells, _ = self.coefficients.shape
        one = slice(None)
        if len(pressure_mbar) == 1 and self._alike:  # the same places on all of them
            one = slice(1)
        scale, begin, step = (v[one, None] for v in (self.scale_mbar, self.begin, self.step))
        low, high = scale * np.sinh(begin), scale * np.sinh(begin + cells * step)
        within = np.clip(pressure_mbar, low, high)
        at = (np.arcsinh(within / scale) - begin) / step
        cell = np.clip(at.astype(np.intp), 0, cells - 1)
        x = at - cell
        c = self.coefficients.reshape(-1, 4)[cell + np.arange(n)[:, None] * cells]
        found = ((c[..., 0] * x + c[..., 1]) * x + c[..., 2]) * x + c[..., 3]
        beyond = pressure_mbar - within
        if beyond.any():
            slope = (3.0 * c[..., 0] * x + 2.0 * c[..., 1]) * x + c[..., 2]
            found += beyond * slope / (step * np.hypot(within, scale))
        return np.asarray(found)


@cache
def _spline() -> Array:
    """Return the coefficients ((nodes − 1) · 4, nodes) of a spline, of values at even nodes."""
    from scipy.interpolate import CubicSpline  # slow to import

    by_cell = CubicSpline(np.arange(_NODES), np.eye(_NODES)).c.transpose(1, 0, 2)
    return np.ascontiguousarray(by_cell.reshape(-1, _NODES))


class TableDomes:
    """Domes from the dimensionless table: any stiffness, any thickness, any opening."""

    def __init__(self, database: Database) -> None:
        """Keep the database."""
        self._database = database

    def __call__(self, problems: Sequence[SkinProblem], top_mbar: Sequence[float]) -> Domes:
        """Return the domes of problems' plain parts (n); none where the table does not hold.

        Features that it cannot speak of are left out; `top_mbar` (n,) are the highest suctions
        asked for. Beyond where a skin creases its dome goes on as the table was filled, smoothly
        in the parameters too: one that ended there would put stairs into every misfit.
        """
        top = np.minimum(np.asarray(top_mbar, dtype=float), _HIGHEST_MBAR)
        scale = top / _BEND
        begin, end = np.arcsinh(-_BELOW_MBAR / scale), np.arcsinh(top / scale)
        step = (end - begin) / (_NODES - 1)
        pressure = scale[:, None] * np.sinh(begin[:, None] + step[:, None] * np.arange(_NODES))
        radius = np.array([p.geometry.radius_mm for p in problems])
        thickness = np.array([p.geometry.thickness_mm for p in problems]) / radius
        values = np.array([p.skin.values for p in problems])
        curves = self._database.any_geometry(problems[0].skin.kappa)
        found, holds_to = curves(values, thickness, pressure * MBAR / values[:, :1])
        reach = holds_to * values[:, 0] / MBAR
        found[reach < FITS.least_reach * top] = np.nan
        coefficients = radius[:, None] * found @ _spline().T
        return Domes(coefficients.reshape(len(problems), -1, 4), scale, begin, step)

    def creases_mbar(self, problem: SkinProblem) -> float:
        """Return the suction beyond which the plain skin creases, infinity where it is not known.

        From there on the table goes on as it was filled: no mesh says where the dome goes.
        """
        radius, values = problem.geometry.radius_mm, np.array([problem.skin.values])
        thickness = np.array([problem.geometry.thickness_mm / radius])
        curves = self._database.any_geometry(problem.skin.kappa)
        top = np.array([[_HIGHEST_MBAR]]) * MBAR / values[:, :1]
        _, holds_to = curves(values, thickness, top)
        return float(holds_to[0] * values[0, 0] / MBAR)

    def seen_errors(self, problem: SkinProblem) -> SeenErrors | None:
        """Return by how much the table was off between its nodes, along suctions; None: not known.

        At the plain skin's stiffness, and for its thickness.
        """
        known = self._database.any_geometry(problem.skin.kappa).seen_errors
        if known is None:
            return None
        geometry = problem.geometry
        seen = known(geometry.thickness_mm / geometry.radius_mm)
        return seen.scaled(problem.skin.values[0] / MBAR)


@dataclass(frozen=True, eq=False)
class Relaxation:
    """The suctions without memory that would dome n skins as memory does.

    As if the dome's answer P(w) relaxed like the stress: p = (1 − Σg) P + Σ g H, dH/dt + H/τ =
    dP/dt. In closed form, since a path is made of straight lines: dH/dt = −A H + dp/dt with
    A = (I − 1 gᵀ) diag(1/τ).
    """

    share: Array  # (n, q) g,
    time_s: Array  # (n, q) and τ, of as many terms each
    rates: Array  # (n, q, 1) gᵀ H is a sum of modes, each of which forgets at a rate of its own,
    modes: Array  # (n, q, 1) and counts so much
    _known: dict[tuple[int, tuple[int, ...]], tuple[PressurePath, Array]] = field(
        default_factory=dict, repr=False
    )

    @classmethod
    def of(cls, prony: Sequence[tuple[Prony, ...]]) -> Relaxation:
        """Return that of skins with these terms (n)."""
        most = max(len(each) for each in prony)
        # A term with a share of zero does nothing.
        even = [(*each, *(Prony(0.0, 1.0 + k) for k in range(most - len(each)))) for each in prony]
        g = np.array([[term.g for term in terms] for terms in even])
        tau = np.array([[term.tau_s for term in terms] for terms in even])
        rates, vectors = np.linalg.eig((np.eye(most) - g[:, None, :]) / tau[:, None, :])
        ones = np.ones((*g.shape, 1))
        modes = np.einsum("nq,nqr->nr", g, vectors) * np.linalg.solve(vectors, ones)[:, :, 0]
        return cls(g, tau, np.real(rates)[:, :, None], np.real(modes)[:, :, None])

    @cached_property
    def rest(self) -> Array:
        """The share (n,) that never relaxes."""
        return np.asarray(1.0 - self.share.sum(axis=1))

    def relaxed_share(self, rise_s: float) -> Array:
        """Return the share (n,) of the stress that relaxes, on average, while the suction rises."""
        at = rise_s / self.time_s
        return np.asarray((self.share * (1.0 + np.expm1(-at) / at)).sum(axis=1))

    def __call__(self, path: PressurePath, time_s: Array, rows: tuple[int, ...]) -> Array:
        """Return the suctions (r, m) of some of the skins at times (r, m), or (1, m) for all.

        They count from the relaxed preload, which is that of the skin by `rest`.
        """
        of = slice(None) if len(rows) == len(self.rates) else list(rows)
        rates, modes = self.rates[of], self.modes[of]
        t, _, slope, _ = path.pieces
        k = np.searchsorted(t, time_s, "right") - 1  # the knot before each sample
        since = np.maximum(time_s - t[k], 0.0)[:, None]
        left = np.exp(-rates * since)
        kept = self._at_knots(path, rows, rates)
        before = np.maximum(k, 0)
        kept = (
            kept[:, :, before[0]]
            if len(before) == 1
            else np.take_along_axis(kept, before[:, None], axis=2)
        )
        each = left * kept + np.append(slope, 0.0)[k][:, None] * ((1.0 - left) / rates)
        held = np.where(k >= 0, (modes * each).sum(axis=1), 0.0)
        return np.asarray((path(time_s) - held) / self.rest[of][:, None])

    def _at_knots(self, path: PressurePath, rows: tuple[int, ...], rates: Array) -> Array:
        """Return the modes' H (r, q, knots); known for curves that feel the same."""
        known = self._known.get((id(path), rows))
        if known is None:
            _, length, slope, jump = path.pieces
            first = np.full((*rates.shape[:2], 1), path.pressure_mbar[0])  # from zero
            left = np.exp(-rates * length)
            gained = jump - slope * np.expm1(-rates * length) / rates
            known = path, remembered(left, np.concatenate([first, gained], axis=2))
            self._known[(id(path), rows)] = known  # with the path, whose name is kept so
        return known[1]


def remembered(share: Array, gained: Array) -> Array:
    """Return h (..., knots) of h_k = share_k h_{k-1} + gained_k, in as many steps as knots double.

    `share` (..., knots - 1) is what is left of the knot before.
    """
    share = np.concatenate([np.zeros_like(gained[..., :1]), share], axis=-1)
    h, step = gained.copy(), 1
    while step < h.shape[-1]:
        h[..., step:] = h[..., step:] + share[..., step:] * h[..., :-step]
        share[..., step:] = share[..., step:] * share[..., :-step]
        step *= 2
    return h


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
