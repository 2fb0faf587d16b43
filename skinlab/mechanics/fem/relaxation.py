"""The suction of a skin whose stress relaxes, stepped in time along a pressure path.

Finite-strain linear viscoelasticity on the isochoric second Piola-Kirchhoff stress (Simo, Comput.
Methods Appl. Mech. Eng. 60 (1987) 153; Holzapfel, Nonlinear Solid Mechanics, 6.10):

    S = S_vol + (1 − Σ g_i) S_iso + Σ g_i H_i,    dH_i/dt + H_i/τ_i = dS_iso/dt.

Over a step of Δt = x τ, with S_iso taken as the parabola through the last three points in time (as
a straight line after a corner of the path), the integral is exact:

    H₁ = e^(−x) H₀ + φ (S₁ − S₀) + ψ Δt² D₂,
    φ = (1 − e^(−x))/x,    ψ = φ − 2 (1 − e^(−x)(1 + x))/x²,

D₂ the second divided difference. H₁ is linear in S₁, so that every step is an elastic problem of
the same law, its isochoric energy scaled by 1 − Σ g + Σ g (φ + ψ r), beside a stress that is
known. It is symmetric and has an energy, and costs no more than an elastic step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinlab.errors import InputError
from skinlab.mechanics.fem.admissibility import fault
from skinlab.mechanics.fem.assembly import Assembly, State
from skinlab.mechanics.fem.banded import Factor
from skinlab.mechanics.fem.newton import Point, StepSettings, follow, solve_linear, solve_point
from skinlab.mechanics.fem.skin import Prepared, Prony
from skinlab.mechanics.fem.suction import MBAR

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

Array = NDArray[np.float64]

# Newton ends ten nanometres off: time steps make errors ten times as large.
SETTINGS = StepSettings(correction=1e-5)
_FIRST_STEP_ALLOWANCE = 10.0  # as for the elastic path: its error is of lower order, and larger
_ORDER = 4.0  # of the extrapolation's error


@dataclass(frozen=True)
class RelaxingCurve:
    """Apex deflection along the path; NaN from where the model no longer holds."""

    times_s: Array  # (k,) knots, in order; a jump of pressure has two at the same time
    pieces: tuple[tuple[float, float, CubicSpline], ...]  # start, end, deflection (mm) of time
    start_mm: float  # at the first time, on the side of the path
    end_s: float  # the path's end, or the last time that converged and is admissible
    holds_to_mbar: float
    stopped: str
    steps: int
    iterations: int

    def __call__(self, time_s: ArrayLike) -> Array:
        """Return the deflection (mm) at these times; before and after, that at the path's ends."""
        t = np.asarray(time_s, dtype=float)
        w = np.full(t.shape, self.start_mm)
        for start, end, piece in self.pieces:
            inside = t >= start
            w[inside] = piece(np.minimum(t[inside], end))
        if self.stopped:
            w[t > self.end_s + 1e-12] = np.nan
        return w


@dataclass(frozen=True, eq=False)
class _Step:
    """A converged step of so many seconds: the point, S_iso there, the known part of each H."""

    point: Point
    iso: Array
    parts: list[Array]
    dt: float


@dataclass
class _History:
    """Where the step starts from, and what of the past it depends on."""

    unknowns: Array
    iso: Array  # S_iso now, (4, m, q)
    over: list[Array]  # H_i now
    # of the present segment: S_iso one step before, and how long that step was
    iso_before: Array | None = None
    dt_before: float = 0.0


@dataclass
class _Segment:
    """Converged points of one straight piece of the path; θ runs from 0 to 1 along it."""

    at: list[float] = field(default_factory=list)
    unknowns: list[Array] = field(default_factory=list)
    slope: Array | None = None  # du/dθ at the start
    end_slope: float = 0.0  # dw/dθ at the end

    def predict(self, theta: float) -> Array:
        """Return the unknowns expected at θ: Newton's polynomial, the start counted twice."""
        nodes, values = self.at[-4:], list(self.unknowns[-4:])
        doubled = len(self.at) < 4 and self.slope is not None
        if doubled:
            nodes, values = [nodes[0], *nodes], [values[0], *values]
        table = values
        result, product = table[-1].copy(), 1.0
        for order in range(1, len(nodes)):
            table = [
                self.slope
                if doubled and order == 1 and k == 0 and self.slope is not None
                else (table[k + 1] - table[k]) / (nodes[k + order] - nodes[k])
                for k in range(len(table) - 1)
            ]
            product *= theta - nodes[-order]
            result += product * table[-1]
        return result


def isochoric_stress(prepared: Prepared, unknowns: Array) -> Array | None:
    """Return S_iso (4, m, q) of the skin's own tissue, MPa, in the order rr, rz, zz, θθ.

    None where an element is turned inside out, as the last correction of one at a crease may do.
    """
    assembly = prepared.assembly
    f = assembly.deformation_gradients(assembly.full(unknowns))
    rr, rz, zr, zz, hoop = f
    det = (rr * zz - rz * zr) * hoop
    if not det.min() > 0.0:
        return None
    c = np.stack([rr * rr + zr * zr, rr * rz + zr * zz, rz * rz + zz * zz, hoop * hoop])
    minor = c[0] * c[2] - c[1] * c[1]
    i1 = c[0] + c[2] + c[3]
    i2 = minor + (c[0] + c[2]) * c[3]
    by_i1, by_i2, by_j = prepared.isochoric_first(i1, i2, det)
    inverse = np.stack([c[2] / minor, -c[1] / minor, c[0] / minor, 1 / c[3]])
    identity = np.array([1.0, 0.0, 1.0, 1.0])[:, None, None]
    s = 2 * ((by_i1 + by_i2 * i1) * identity - by_i2 * c) + det * by_j * inverse
    own = prepared.body.own
    return np.asarray(s if own is None else s * own[:, None])


@lru_cache(maxsize=256)  # of a step that is tried and then taken, of curves with equal steps
def step_factors(x: float) -> tuple[float, float, float]:
    """Return e^(−x), φ and ψ of the module's formula; x = Δt/τ ≥ 0."""
    e = math.exp(-x)
    if x < 0.1:  # the closed forms cancel: series, to round-off
        phi = chi = 0.0
        for k in range(12):
            term = (-x) ** k / math.factorial(k)
            phi += term / (k + 1)
            chi += term / (k + 2)
    else:
        phi, chi = -math.expm1(-x) / x, (1 - e * (1 + x)) / (x * x)
    return e, phi, phi - 2 * chi


def relax(
    prepared: Prepared,
    prony: tuple[Prony, ...],
    time_s: Array,
    pressure_mbar: Array,
    scale_mm: float,
    settings: StepSettings = SETTINGS,
    preload_mbar: float = 0.0,
) -> RelaxingCurve:
    """Return the apex deflection along the path with these knots (k,), straight between them.

    Before its first time the skin has rested at `preload_mbar`, relaxed; the path's pressure comes
    on top of it, and the deflection counts from there. Two knots at the same time are a jump.

    Raises:
        InputError: the time runs backwards, or there is no path.
    """
    if len(time_s) < 2 or np.any(np.diff(time_s) < 0):
        raise InputError("a pressure path needs two knots or more, in the order of time")
    return _Stepper(prepared, prony, scale_mm, settings).run(time_s, pressure_mbar, preload_mbar)


class _Stepper:
    def __init__(
        self,
        prepared: Prepared,
        prony: tuple[Prony, ...],
        scale_mm: float,
        settings: StepSettings,
    ) -> None:
        self.prepared, self.prony, self.settings = prepared, prony, settings
        self.assembly: Assembly = prepared.assembly
        self.apex = prepared.apex
        self.wanted = settings.extrapolation_error * scale_mm
        self.first = settings.first_step * scale_mm
        self.share = sum(term.g for term in prony)
        self.iterations = self.steps = 0
        self.reason = ""
        self.contraction = math.inf  # as seen last, see `solve_point`
        self._tangent: tuple[Array, State, Factor, Array] | None = None  # of these unknowns

    def run(self, time_s: Array, pressure_mbar: Array, preload_mbar: float) -> RelaxingCurve:
        from scipy.interpolate import CubicSpline  # slow to import

        history = self._rest(preload_mbar)
        zero = 0.0 if history is None else float(history.unknowns[self.apex])
        times, pressures = list(time_s), list(pressure_mbar)
        if pressures[0] != 0.0:  # the path starts under suction: it came at once
            times, pressures = [times[0], *times], [0.0, *pressures]
        pieces: list[tuple[float, float, CubicSpline]] = []
        knots = [float(times[0])]
        reached, end_s = 0.0, float(times[0])
        start_mm = 0.0
        for (t0, p0), (t1, p1) in pairwise(zip(times, pressures, strict=True)):
            if history is None:
                break
            if t1 == t0 and p1 == p0:
                continue
            segment = self._segment(history, t1 - t0, p0 + preload_mbar, p1 + preload_mbar)
            w = np.array([u[self.apex] for u in segment.unknowns]) - zero
            at = np.array(segment.at)
            done = at[-1]
            reached = max(reached, p0, p0 + done * (p1 - p0))
            end_s = t0 + done * (t1 - t0)
            if t1 == t0:
                if not pieces:
                    start_mm = float(w[-1])
            elif len(w) > 1:
                slope = 0.0 if segment.slope is None else float(segment.slope[self.apex])
                spline = CubicSpline(
                    t0 + at * (t1 - t0), w,
                    bc_type=((1, slope / (t1 - t0)), (1, segment.end_slope / (t1 - t0))),
                )  # fmt: skip
                pieces.append((t0, end_s, spline))
                knots += list(t0 + at[1:] * (t1 - t0))
            if self.reason:
                break
        stopped = "" if not self.reason else f"{self.reason} beyond {reached:.2f} mbar"
        return RelaxingCurve(
            np.array(knots), tuple(pieces), start_mm, end_s, reached, stopped,
            self.steps, self.iterations,
        )  # fmt: skip

    def _rest(self, preload_mbar: float) -> _History | None:
        """Return the state long after the preload came, or None where there is no such state."""
        unknowns = np.zeros(self.assembly.n)
        if preload_mbar > 0:
            path = follow(
                self.assembly, preload_mbar * MBAR, self.prepared.parameters(1 - self.share),
                1.0, self.settings, watch=self.apex,
            )  # fmt: skip
            if path.stopped:
                self.reason = path.stopped
                return None
            unknowns = path.displacements[-1]
        iso = isochoric_stress(self.prepared, unknowns)
        if iso is None:
            self.reason = "an element is turned inside out"
            return None
        return _History(unknowns, iso, [np.zeros_like(iso) for _ in self.prony])

    def _segment(self, history: _History, duration: float, p0: float, p1: float) -> _Segment:
        """Step along one straight piece; `history` is left at its end."""
        segment = _Segment([0.0], [history.unknowns])
        segment.slope = self._rate(history, duration, p0, p1)
        history.iso_before = None
        if segment.slope is None:
            self.reason = "the tangent is not positive definite"
            return segment
        speed = abs(float(segment.slope[self.apex]))
        step = min(1.0, self.first / max(speed, 1e-300))
        if duration > 0:  # what relaxes fast bends the curve first
            step = min(step, max(0.5 * min(t.tau_s for t in self.prony) / duration, 1e-3))
        tries = 0
        while segment.at[-1] < 1.0:
            left = 1.0 - segment.at[-1]
            n = max(1, math.ceil(left / step - 1e-9))
            taken = left / n if n <= 2 else step
            theta = 1.0 if n == 1 else segment.at[-1] + taken
            guess = segment.predict(theta)
            found = self._solve(history, guess, taken * duration, (p0 + theta * (p1 - p0)) * MBAR)
            if found is None:
                tries += 1
                step = 0.35 * taken
                if tries > self.settings.tries or step * abs(p1 - p0) < 1e-6 * (p1 != p0):
                    self.reason = "no convergence"
                    break
                continue
            point = found.point
            self.reason = fault(self.assembly, point.unknowns, point.state, self.settings.limits)
            if self.reason:
                close = taken * abs(p1 - p0) <= self.settings.limit_mbar
                if close or taken < 1e-3:
                    break
                self.reason = ""
                step = 0.5 * taken
                continue
            error = abs(float(guess[self.apex] - point.unknowns[self.apex]))
            first = len(segment.at) == 1
            wanted = self.wanted * (_FIRST_STEP_ALLOWANCE if first else 1.0)
            order = 2.0 if first else 3.0 if len(segment.at) == 2 else _ORDER
            change = 0.9 * (wanted / max(error, 1e-3 * wanted)) ** (1 / order)
            step = taken * min(2.0, max(0.25, change))
            if error > 8.0 * wanted and taken > 1e-5:
                continue
            tries = 0
            self._accept(history, found)
            segment.at.append(theta)
            segment.unknowns.append(point.unknowns)
            self.steps += 1
        if not self.reason:
            rate = self._rate(history, duration, p0, p1, end=True)
            segment.end_slope = 0.0 if rate is None else float(rate[self.apex])
        return segment

    def _known(self, history: _History, dt: float) -> tuple[float, list[Array], Array]:
        """Return the factor on S_iso, the known part of each H, and the known stress."""
        factor = 1.0 - self.share
        parts = []
        total = np.zeros_like(history.iso)
        for term, over in zip(self.prony, history.over, strict=True):
            e, phi, psi = step_factors(dt / term.tau_s)
            coefficient, part = phi, e * over
            if history.iso_before is not None and dt > 0:
                r = dt / (dt + history.dt_before)
                coefficient += psi * r
                part -= psi * r * (dt / history.dt_before) * (history.iso - history.iso_before)
            part -= coefficient * history.iso
            factor += term.g * coefficient
            parts.append(part)
            total += term.g * part
        return factor, parts, total

    def _solve(
        self, history: _History, guess: Array, dt: float, pressure_mpa: float
    ) -> _Step | None:
        factor, parts, stress = self._known(history, dt)
        point, spent = solve_point(
            self.assembly, guess, pressure_mpa, self.prepared.parameters(factor),
            self.settings, stress, self.contraction,
        )  # fmt: skip
        self.iterations += spent
        iso = None if point is None else isochoric_stress(self.prepared, point.unknowns)
        if point is None or iso is None:
            self.contraction = math.inf
            return None
        if point.contraction is not None:
            self.contraction = point.contraction
        return _Step(point, iso, parts, dt)

    def _accept(self, history: _History, step: _Step) -> None:
        iso, parts, dt = step.iso, step.parts, step.dt
        for k, term in enumerate(self.prony):
            _, phi, psi = step_factors(dt / term.tau_s)
            coefficient = phi
            if history.iso_before is not None and dt > 0:
                coefficient += psi * dt / (dt + history.dt_before)
            history.over[k] = parts[k] + coefficient * iso
        history.iso_before, history.dt_before = history.iso, dt
        history.iso, history.unknowns = iso, step.point.unknowns

    def _rate(
        self, history: _History, duration: float, p0: float, p1: float, *, end: bool = False
    ) -> Array | None:
        """Return du/dθ at this end of the piece: K du/dt = load dp/dt + the forces of Σ g/τ H.

        K is the tangent of an instant, in which dH = dS_iso.
        """
        pressure = (p1 if end else p0) * MBAR
        if self._tangent is None or self._tangent[0] is not history.unknowns:
            factorised = self._factorise(history, pressure)
            if factorised is None:
                return None
            self._tangent = (history.unknowns, *factorised)
        _, state, factor, fading = self._tangent
        right = (p1 - p0) * MBAR * state.load + duration * fading
        return solve_linear(factor, state, pressure, right)

    def _factorise(
        self, history: _History, pressure_mpa: float
    ) -> tuple[State, Factor, Array] | None:
        """Return the state, the tangent's factor and the forces that fade in a second, N/s."""
        nothing = np.zeros_like(history.iso)
        pairs = list(zip(self.prony, history.over, strict=True))
        stress = sum((term.g * (over - history.iso) for term, over in pairs), nothing)
        fades = sum((term.g / term.tau_s * over for term, over in pairs), nothing)
        parameters = self.prepared.parameters()
        state = self.assembly.evaluate(history.unknowns, pressure_mpa, parameters, stress)
        if state is None:
            return None
        factor = state.matrix.factorise()
        if factor is None:
            return None
        return state, factor, self.assembly.forces(state.deformation, fades)
