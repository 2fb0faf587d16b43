"""Calibrate a probe: its errors from readings on phantoms, with what the phantoms leave open.

All curves are fitted at once by least squares: five parameters of the probe (`PARAMETERS`), and for
each phantom how far it is from its sheet, with the sheet's standard deviations as priors. A rigid
body shows zero and gain of the deflection; a silicone sheet, whose dome is a known function of
p/X1, shows gain and zero of the pressure, and the lag where the pressure moves fast. On sheets
alone a gain of the pressure is the same as stiffer silicone, so that its interval is never narrower
than what the sheets' stiffnesses leave open.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import chi2, norm

from skinlab.curves.curve import Curve
from skinlab.curves.phantoms import Phantom
from skinlab.curves.pressure_path import PressurePath
from skinlab.curves.probe_file import PARAMETERS, CheckCurve, Interval, ProbeFile
from skinlab.errors import InputError, NotTrustworthyError
from skinlab.inference.error_models.quantised import step_of
from skinlab.inference.noise import MESH_ERROR, legendre, pressure_noise_mbar, roughness
from skinlab.inference.settings import CALIBRATION, NOISE
from skinlab.mechanics.effects.model import problem_of, solve_skin
from skinlab.mechanics.fem.skin import Skin
from skinlab.mechanics.fem.suction import Geometry

Array = NDArray[np.float64]

# What a probe can be before anything is measured; in this order, mm for µm
_MEAN = np.array([1.0, 0.0, 1.0, 0.0, 0.0])
_UNITS = np.array([1.0, 1e3, 1.0, 1.0, 1.0])
_ROUNDED = 1 / math.sqrt(12.0)  # of a step: what rounding to it adds
_STEP_MBAR = 0.05  # for slopes


@dataclass(frozen=True, eq=False)
class Reading:
    """A curve that was measured on a phantom."""

    phantom: Phantom
    curve: Curve


@lru_cache(maxsize=64)
def dome(
    phantom: Phantom, aperture_mm: float, thickness_mm: float, goal_mbar: float
) -> Callable[[Array], Array]:
    """Return the dome (mm) of a silicone sheet as a function of true suction (mbar).

    Raises:
        NotTrustworthyError: the finite elements do not hold that far.
    """
    assert phantom.X1_MPa is not None
    law = Skin((phantom.X1_MPa, 0.0, phantom.nu), "consistent")
    problem = problem_of(law, {}, Geometry(aperture_mm, thickness_mm))
    solved = solve_skin(problem, PressurePath((0.0, 1.0), (0.0, goal_mbar)))
    if solved.instant is None or solved.holds_to_mbar < goal_mbar / CALIBRATION.spare:
        raise NotTrustworthyError(
            f"phantom {phantom.name}: its dome is known up to {solved.holds_to_mbar:.0f} mbar; "
            f"expected {goal_mbar / CALIBRATION.spare:.0f} mbar"
        )
    return solved.instant


class _Sheet:
    """The dome of one silicone phantom near its stated stiffness and thickness."""

    def __init__(self, phantom: Phantom, aperture_mm: float, top_mbar: float) -> None:
        grid = CALIBRATION.grid_mbar
        goal = CALIBRATION.spare * grid * math.ceil(top_mbar / grid)
        step = max(phantom.thickness_sd_mm, 1e-3 * phantom.thickness_mm)
        h = phantom.thickness_mm
        self._goal = goal / CALIBRATION.spare
        self._dome = dome(phantom, aperture_mm, h, goal)
        self._step_mm = step
        self._up, self._down = (dome(phantom, aperture_mm, h + s, goal) for s in (step, -step))

    def __call__(self, pressure_mbar: Array, off: Array) -> Array:
        """Return the dome (n,); `off`: log stiffness, thickness in mm, shapes of mesh errors."""
        softer = pressure_mbar * np.exp(-off[0])
        thicker = (self._up(softer) - self._down(softer)) / (2 * self._step_mm)
        height = self._dome(softer) + off[1] * thicker
        x = np.clip(pressure_mbar / self._goal, 0.0, 1.0)
        shapes = legendre(x, len(MESH_ERROR)) * np.array(MESH_ERROR)
        return np.asarray(height * (1.0 + shapes @ off[2:]))


class _Readings:
    """The samples of one curve on one phantom."""

    def __init__(self, reading: Reading, at: slice, sheet: _Sheet | None) -> None:
        curve, program = reading.curve, reading.curve.setup.program
        self.phantom, self.curve, self.at, self._sheet = reading.phantom, curve, at, sheet
        noise_mbar = pressure_noise_mbar(curve.time_s, curve.pressure_mbar)
        self.step_mbar = step_of(curve.pressure_mbar, NOISE.least_mbar)
        self.noise_mbar = max(math.hypot(noise_mbar, self.step_mbar * _ROUNDED), NOISE.least_mbar)
        self.zero = np.zeros(len(curve), dtype=bool)
        self.steady = np.ones(len(curve), dtype=bool)
        # A reading of the pressure by itself would let its noise pass for movement, and so for lag
        step_s = float(np.median(np.diff(curve.time_s)))
        few, most = CALIBRATION.smooth, CALIBRATION.smooth_s / step_s
        wanted = min(few * (self.noise_mbar / CALIBRATION.smooth_mbar) ** 2, most)
        ends = max(few // 2, (int(wanted) - 1) // 2)
        padded = np.pad(curve.pressure_mbar, ends, mode="reflect", reflect_type="odd")
        self._smooth_mbar = np.convolve(padded, np.ones(2 * ends + 1) / (2 * ends + 1), "valid")
        blurred_s = max(few, ends + 1) * step_s
        if sheet is None or program is None:
            return
        # Where the valve is open and nothing is left, the truth is zero
        segment = curve.segment
        index = program.segment_at(curve.time_s - curve.time_s[0]) if segment is None else segment
        for k, phase in enumerate(program.phases):
            here = np.flatnonzero(index == k)
            if k and here.size:  # around a corner of the program the smooth pressure is not true
                since = curve.time_s - curve.time_s[here[0]]
                self.steady &= (since < -blurred_s) | (since > blurred_s + CALIBRATION.corner_s)
            if phase == "rest" and here.size:
                since = curve.time_s[here] - curve.time_s[here[0]]
                self.zero[here[since >= (0.0 if k == 0 else CALIBRATION.settled_s)]] = True

    def heights_mm(self, x: Array, pressure_mbar: Array) -> Array:
        """Return what the probe reads (n,) at readings of the pressure (n,), without lag."""
        gain, offset, pressure_gain, pressure_offset, _ = x[:5]
        if self._sheet is None:
            height = np.full(len(pressure_mbar), self.phantom.height_mm + x[self.at][0])
        else:
            height = self._sheet((pressure_mbar - pressure_offset) / pressure_gain, x[self.at])
        return np.asarray(gain * height + offset)

    def _felt_mbar(self, x: Array) -> Array:
        """Return the readings of the pressure (n,) that belong to the deflections."""
        t = self.curve.time_s
        # Where the truth is zero, the pressure's noise says nothing of the deflection
        felt = np.interp(t - x[4], t, self._smooth_mbar)
        return np.asarray(np.where(self.zero, x[3], felt))

    def read_mm(self, x: Array) -> Array:
        """Return what the probe reads at its samples (n,)."""
        return self.heights_mm(x, self._felt_mbar(x))

    def slope_mm_per_mbar(self, x: Array) -> Array:
        """Return how a reading of the pressure moves what is read (n,)."""
        if self._sheet is None:
            return np.zeros(len(self.curve))
        felt = self._felt_mbar(x)
        up, down = (self.heights_mm(x, felt + s) for s in (_STEP_MBAR, -_STEP_MBAR))
        return np.where(self.zero, 0.0, (up - down) / (2 * _STEP_MBAR))

    def sigma_mm(self, x: Array, noise_mm: float) -> Array:
        """Return the samples' standard deviations (n,), the pressure's noise included."""
        return np.asarray(np.hypot(noise_mm, self.slope_mm_per_mbar(x) * self.noise_mbar))


def calibrate(
    readings: Sequence[Reading],
    *,
    serial_number: str,
    model: str,
    now: datetime,
    valid_days: float = 365.0,
) -> ProbeFile:
    """Return the probe file that curves on phantoms make.

    Raises:
        InputError: there are too few samples, or curves of several openings.
        NotTrustworthyError: a phantom's dome is not known that far.
    """
    apertures = {r.curve.setup.aperture_mm for r in readings}
    if len(apertures) != 1:
        raise InputError("a calibration needs curves of one opening")
    (aperture_mm,) = apertures
    parts, priors = _parts(readings, aperture_mm)
    noise_mm = _noise_mm(readings)
    x, covariance, misfit = _fit(parts, priors, noise_mm)
    strain = {one.phantom.name: float(np.abs(x[one.at] / priors[one.at]).max()) for one in parts}
    covariance = covariance * max(1.0, misfit, (max(strain.values()) / CALIBRATION.far) ** 2)
    floor = np.array(CALIBRATION.floor)
    step_s = float(np.median([np.median(np.diff(r.curve.time_s)) for r in readings]))
    floor[4] = CALIBRATION.floor_lag * step_s
    step_mm = max(step_of(r.curve.deflection_mm, 1e-3 * CALIBRATION.least_um) for r in readings)
    floor[1] = math.hypot(floor[1], _rounded_off(step_mm, noise_mm))
    floor[3] = math.hypot(floor[3], *(_rounded_off(p.step_mbar, p.noise_mbar) for p in parts))
    own = covariance[: len(PARAMETERS), : len(PARAMETERS)] + np.diag(floor**2)
    sd = np.sqrt(np.diag(own))
    half = float(norm.ppf(0.95)) * sd
    found = {
        name: Interval(
            float(v * unit), float((v - h) * unit), float((v + h) * unit)
        )
        for name, v, h, unit in zip(PARAMETERS, x, half, _UNITS, strict=False)
    }  # fmt: skip
    own = own * np.outer(_UNITS, _UNITS)
    return ProbeFile(
        schema="skinlab.probe/1",
        serial_number=serial_number,
        model=model,
        aperture_mm=aperture_mm,
        calibrated_utc=now.isoformat(timespec="seconds"),
        valid_until_utc=(now + timedelta(days=valid_days)).isoformat(timespec="seconds"),
        **found,
        covariance=[[float(v) for v in row] for row in own],
        noise_um=1e3 * noise_mm,
        pressure_noise_mbar=float(np.median([one.noise_mbar for one in parts])),
        misfit=misfit,
        not_determined=[
            n
            for n, s, before in zip(PARAMETERS, sd, CALIBRATION.before, strict=True)
            if s > CALIBRATION.open * before
        ],
        phantoms_off=[name for name, far in strain.items() if far > CALIBRATION.far],
        phantoms=list(dict.fromkeys(r.phantom for r in readings)),
        check=_check_curve(parts, x),
    )


def _rounded_off(step: float, noise: float) -> float:
    """Return the standard deviation of a mean of readings from the truth: noise hides the step.

    `noise` is that of the rounded readings. First wave of Widrow and Kollár 2008, chapter 15.
    """
    if not step:
        return 0.0
    before = max(noise**2 - (step * _ROUNDED) ** 2, 0.0) / step**2
    return step / (math.sqrt(2.0) * math.pi) * math.exp(-2.0 * math.pi**2 * before)


def _parts(readings: Sequence[Reading], aperture_mm: float) -> tuple[list[_Readings], Array]:
    """Return the curves, and the standard deviations (k,) of all unknowns before."""
    parts: list[_Readings] = []
    places: dict[Phantom, tuple[slice, _Sheet | None]] = {}
    priors = list(CALIBRATION.before)
    for reading in readings:
        phantom = reading.phantom
        if phantom not in places:
            begin, sheet = len(priors), None
            if phantom.kind == "rigid":
                priors.append(max(phantom.height_sd_mm, 1e-5))
            else:
                curves = [r.curve for r in readings if r.phantom == phantom]
                top = max(float(c.pressure_mbar.max()) for c in curves)
                sheet = _Sheet(phantom, aperture_mm, top)
                stiffness = max(phantom.X1_relative_sd, 1e-4)
                priors += [stiffness, max(phantom.thickness_sd_mm, 1e-5)]
                priors += [CALIBRATION.meshes] * len(MESH_ERROR)
            places[phantom] = (slice(begin, len(priors)), sheet)
        parts.append(_Readings(reading, *places[phantom]))
    return parts, np.array(priors)


def _noise_mm(readings: Sequence[Reading]) -> float:
    """Return the deflection's noise: on rigid bodies, else where the pressure rests."""
    rigid = [r.curve.deflection_mm for r in readings if r.phantom.kind == "rigid"]
    found = [float(np.std(w, ddof=1)) for w in rigid if len(w) > 5]
    if not found:
        for reading in readings:
            held = np.isin(reading.curve.phase, ["hold", "rest"])
            if held.sum() > 10:
                found.append(roughness(reading.curve.deflection_mm[held]))
    if not found or not np.isfinite(found).all():
        raise InputError("a calibration needs a rigid phantom, or a hold of some samples")
    return max(float(np.sqrt(np.mean(np.square(found)))), 1e-3 * CALIBRATION.least_um)


def _fit(parts: list[_Readings], priors: Array, noise_mm: float) -> tuple[Array, Array, float]:
    """Return the unknowns (k,), their covariance, and χ² per degree of freedom."""
    mean = np.concatenate([_MEAN, np.zeros(len(priors) - len(_MEAN))])
    x, samples = mean.copy(), sum(int(one.steady.sum() + one.zero.sum()) for one in parts)
    for _ in range(CALIBRATION.rounds):
        sigmas = [one.sigma_mm(x, noise_mm) for one in parts]

        def residuals(x: Array, sigmas: list[Array] = sigmas) -> Array:
            rows = [(x - mean) / priors]
            for one, sigma in zip(parts, sigmas, strict=True):
                off = (one.curve.deflection_mm - one.read_mm(x)) / sigma
                rows.append(off[one.steady])
                rows.append((one.curve.pressure_mbar[one.zero] - x[3]) / one.noise_mbar)
            return np.concatenate(rows)

        found = least_squares(residuals, x, x_scale=priors, diff_step=np.full(len(x), 1e-6))
        x = found.x
    squares = float(np.square(found.fun[len(priors) :]).sum())
    misfit = squares / max(samples - len(PARAMETERS), 1)
    slopes = np.asarray(found.jac)
    return x, np.linalg.inv(slopes.T @ slopes), misfit


def _check_curve(parts: list[_Readings], x: Array) -> CheckCurve | None:
    """Return what the probe reads on the first silicone sheet, smooth."""
    for one in parts:
        if one.phantom.kind == "silicone":
            top = float(one.curve.pressure_mbar.max())
            pressure = np.linspace(0.0, top, CALIBRATION.check_points)
            read = one.heights_mm(x, pressure)
            return CheckCurve(one.phantom, pressure.tolist(), read.tolist())
    return None


@dataclass(frozen=True)
class Agreement:
    """What a check curve says: how far zero and gain of the deflection seem to have moved."""

    agrees: bool
    offset_um: Interval
    gain_ratio: Interval
    statistic: float
    limit: float


def check_probe(file: ProbeFile, curve: Curve) -> Agreement:
    """Say whether the probe still reads on its check phantom what it read when it was calibrated.

    A change of the pressure's gain shows as one of the deflection's: it is told that, not which.

    Raises:
        InputError: the probe file has no check curve, or the curve is of another opening or too
            short.
    """
    stored = file.check
    if stored is None:
        raise InputError("the probe file has no check curve: it was calibrated on rigid bodies")
    if curve.setup.aperture_mm != file.aperture_mm or len(curve) < 10:
        raise InputError(f"{curve.name}: no check curve of an opening of {file.aperture_mm:g} mm")
    p0, w0 = np.array(stored.pressure_mbar), np.array(stored.deflection_mm)
    felt = np.interp(curve.time_s - file.lag_s.value, curve.time_s, curve.pressure_mbar)
    bend = np.polynomial.Chebyshev.fit(p0, w0, min(8, len(p0) - 2))
    expected, slope = bend(felt), bend.deriv()(felt)
    noise_mm = max(1e-3 * file.noise_um, 1e-3 * CALIBRATION.least_um)
    noise_mbar = max(
        pressure_noise_mbar(curve.time_s, curve.pressure_mbar), file.pressure_noise_mbar
    )
    sigma = np.hypot(noise_mm, slope * noise_mbar)
    design = np.column_stack([np.ones(len(curve)), expected - w0[0]]) / sigma[:, None]
    off = (curve.deflection_mm - expected) / sigma
    moved = np.linalg.lstsq(design, off)[0]
    own = np.linalg.inv(design.T @ design)
    # Twice: the curve that it is compared with had errors too
    allowed = 2 * own + np.diag([CALIBRATION.check_offset_mm**2, CALIBRATION.check_gain**2])
    statistic = float(moved @ np.linalg.solve(allowed, moved))
    limit = float(chi2.ppf(CALIBRATION.check_sure, 2))
    half = float(norm.ppf(0.95)) * np.sqrt(2 * np.diag(own))
    return Agreement(
        statistic <= limit,
        Interval(*(1e3 * float(v) for v in (moved[0], moved[0] - half[0], moved[0] + half[0]))),
        Interval(*(1 + float(v) for v in (moved[1], moved[1] - half[1], moved[1] + half[1]))),
        statistic,
        limit,
    )
