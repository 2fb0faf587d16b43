"""Sizes of errors that are read from curves, and those of the mesh, which were measured.

How rough a channel is, how a pressure's noise reaches the deflection (dw/dp), and a few shapes in
which the model's own discretisation errs as a whole.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.settings import JUDGEMENT, NOISE
from skinlab.tables.model_errors import LOCKING_SHAPES

Array = NDArray[np.float64]

_QUARTILE = 0.6744897501960817  # the upper one of the normal distribution
_Chebyshev = np.polynomial.Chebyshev
_DEGREE = 8  # of a smooth curve
_TOP_BY_SCALE = 20.0  # the highest pressure by that up to which a curve is taken for straight

# Root mean squares of the relative deviation of the mesh of record from a fine mesh, by orders of
# shifted Legendre polynomials of p/p_max, and of the rest: `python benchmarks/model_error.py`, of
# other 64 skins than benchmarks/results/model_error.json, whose first two are 4 to 6 % larger.
MESH_ERROR = (9.0e-4, 3.2e-4, 1.3e-4, 1.0e-4, 8.0e-5, 4.5e-5, 3.5e-5, 3.5e-5)
MESH_REST = 1.0e-5


def legendre(x: Array, orders: int) -> Array:
    """Return shifted Legendre polynomials (n, orders) at x (n,) in 0…1, of mean square 1."""
    scale = np.sqrt(2.0 * np.arange(orders) + 1.0)
    return np.asarray(np.polynomial.legendre.legvander(2.0 * x - 1.0, orders - 1) * scale)


def mesh_error_shapes(pressure_mbar: Array, deflection_mm: Array) -> Array:
    """Return the shapes (u, m), mm, in which the model's own discretisation errs."""
    return _shapes(MESH_ERROR, pressure_mbar, deflection_mm)


def locking_shapes(pressure_mbar: Array, deflection_mm: Array) -> Array:
    """Return the shapes (u, m), mm, in which a mesh errs that locks by the whole deflection."""
    return _shapes(LOCKING_SHAPES, pressure_mbar, deflection_mm)


def _shapes(sizes: Sequence[float], pressure_mbar: Array, deflection_mm: Array) -> Array:
    top = max(float(pressure_mbar.max(initial=0.0)), 1e-9)
    x = np.clip(pressure_mbar / top, 0.0, 1.0)
    return np.asarray(legendre(x, len(sizes)) * np.array(sizes) * deflection_mm[:, None])


def jumps(residual_mm: Array, step_mm: float = 0.0) -> bool:
    """Return whether what a fit leaves (n,) has a step in it: the probe slipped, or was touched.

    Straight lines through the samples on either side miss each other there by far more than
    elsewhere, and so do two neighbours, which they do not where a smooth misfit bends. One step of
    the readings (`step_mm`), or two, is none of the skin's: a slow curve rises by such.
    """
    side = NOISE.side
    if len(residual_mm) < 2 * side + NOISE.fewest:
        return False
    x = np.arange(side) - 0.5 * (side - 1)
    ahead = 1.0 / side + x * (0.5 * side) / float(x @ x)  # the line, half a sample beyond its end
    lines = np.lib.stride_tricks.sliding_window_view(residual_mm, side)
    gaps = np.abs(lines[side:] @ ahead[::-1] - lines[:-side] @ ahead)
    rises = np.diff(residual_mm)[side - 3 : 3 - side]
    beside = np.abs(rises[2:-2] - 0.25 * (rises[:-4] + rises[1:-3] + rises[3:-1] + rises[4:]))
    at = int(gaps.argmax())
    usual = [NOISE.jump * float(np.median(v)) / _QUARTILE for v in (gaps, beside)]
    return all(
        v[at] - 2.0 * step_mm > least for v, least in zip((gaps, beside), usual, strict=True)
    )


def roughness(values: Array) -> float:
    """Return the standard deviation of what in values (n,) is as rough as white noise.

    From fourth differences, which a smooth course hardly has, without the largest: corners of a
    program and single glitches do not count. In the unit of the values; NaN below 5 of them.
    """
    if len(values) < 5:
        return float("nan")
    bend = np.abs(
        values[2:-2] - (-values[:-4] + 4 * values[1:-3] + 4 * values[3:-1] - values[4:]) / 6.0
    )
    scale = float(np.sqrt(1.0 + (1 + 16 + 16 + 1) / 36.0))
    usual = float(np.median(bend) / _QUARTILE)
    kept = bend[bend <= NOISE.corner * usual]
    return float(np.sqrt(np.mean(kept**2))) / scale


def contradicted_pressure_noise(
    time_s: Array, pressure_mbar: Array, stated_mbar: float
) -> float | None:
    """Return the noise of a pressure channel (n,), mbar, where it contradicts the stated one.

    Rounding may be part of a statement or not. A channel without any noise is a program, and says
    nothing of a sensor.
    """
    if len(time_s) < JUDGEMENT.pressure_fewest:
        return None
    found = pressure_noise_mbar(time_s, pressure_mbar)
    levels = np.unique(np.round(pressure_mbar, 6))
    step = float(np.diff(levels).min()) if len(levels) > 1 else 0.0
    rounded = float(np.hypot(found, step / np.sqrt(12.0)))
    times, least = JUDGEMENT.pressure_contradicted, JUDGEMENT.pressure_least_mbar
    too_small = found > times * max(np.hypot(stated_mbar, step / np.sqrt(12.0)), least)
    too_large = found > 0.0 and times * rounded < stated_mbar
    return found if too_small or too_large else None


def pressure_noise_mbar(time_s: Array, pressure_mbar: Array) -> float:
    """Return the standard deviation of the noise in a pressure channel (n,), mbar.

    Each reading is compared with the cubic through its four neighbours in time, which a pump's
    course follows closely, and with the reading before, which steps of a program leave alone; by
    the median, so that corners do not count.
    """
    n = len(time_s)
    if n < NOISE.fewest:
        return 0.0
    at = time_s[2:-2]
    others = [time_s[2 + s : n - 2 + s] for s in (-2, -1, 1, 2)]
    guess, variance = np.zeros(n - 4), np.ones(n - 4)
    for i, s in enumerate((-2, -1, 1, 2)):
        weight = np.ones(n - 4)
        for j, other in enumerate(others):
            if j != i:
                weight *= (at - other) / (others[i] - other)
        guess += weight * pressure_mbar[2 + s : n - 2 + s]
        variance += weight**2
    misses = np.abs(pressure_mbar[2:-2] - guess) / np.sqrt(variance)
    steps = np.abs(np.diff(pressure_mbar)) / np.sqrt(2.0)
    found = min(float(np.median(misses)), float(np.median(steps))) / _QUARTILE
    return found if found >= NOISE.least_mbar else 0.0


def slope_mm_per_mbar(pressure_mbar: Array, deflection_mm: Array) -> Array:
    """Return dw/dp (u,) of a smooth curve given at pressures in any order, within about 1 %.

    Where these are `held` samples do not tell it: 0 at fewer than three.
    """
    scale, smooth = _smooth(pressure_mbar, deflection_mm)
    if smooth is None:
        return np.zeros(len(pressure_mbar))
    s = np.arcsinh(pressure_mbar / scale)
    return np.asarray(smooth.deriv()(s) / np.hypot(pressure_mbar, scale))


def sample_sd_mm(
    time_s: Array,
    pressure_mbar: Array,
    deflection_mm: Array,
    noise_um: float,
    pressure_mbar_sd: float | None,
) -> Array:
    """Return a sample's standard deviation (u,), mm, on a smooth curve: of both channels.

    `pressure_mbar_sd`: of a reading of the pressure; None: what its course shows.
    """
    found = pressure_noise_mbar(time_s, pressure_mbar)
    spread_mbar = found if pressure_mbar_sd is None else pressure_mbar_sd
    slope = slope_mm_per_mbar(pressure_mbar, deflection_mm)
    return np.hypot(1e-3 * noise_um, slope * spread_mbar)


def held(pressure_mbar: Array) -> bool:
    """Return whether pressures (u,) are at a few places only, as those of a square wave."""
    _, s = _places(pressure_mbar)
    apart = NOISE.level * float(np.arcsinh(_TOP_BY_SCALE))
    return len(np.unique(np.floor(s / apart))) < NOISE.levels


def smooth_mm(pressure_mbar: Array, deflection_mm: Array) -> Array:
    """Return the deflections (u,) of a smooth curve of the pressure, without the samples' noise."""
    scale, smooth = _smooth(pressure_mbar, deflection_mm)
    if smooth is None:
        return deflection_mm
    return np.asarray(smooth(np.arcsinh(pressure_mbar / scale)))


def pressure_error_mm(pressure_mbar: Array, deflection_mm: Array, sd_mbar: Array) -> Array:
    """Return the root mean square (u,) of what noise of the pressure readings does to deflections.

    It is |dw/dp| sd where the curve is straight over the noise's reach; a soft skin's is not near
    zero pressure. By Gauss-Hermite quadrature with three points.
    """
    scale, smooth = _smooth(pressure_mbar, deflection_mm)
    if smooth is None:
        return np.zeros(len(pressure_mbar))
    slope, ends = smooth.deriv(), smooth.domain

    def curve(p: Array) -> Array:
        s = np.arcsinh(p / scale)
        near = np.clip(s, *ends)
        return np.asarray(smooth(near) + slope(near) * (s - near))

    here, reach = curve(pressure_mbar), np.sqrt(3.0) * sd_mbar
    squares = sum(np.square(curve(pressure_mbar + way * reach) - here) for way in (-1.0, 1.0))
    return np.asarray(np.sqrt(squares / 6.0))


def _places(pressure_mbar: Array) -> tuple[float, Array]:
    """Return a pressure and arcsinh(p / that) (u,), along which curves bend evenly."""
    top = max(float(np.abs(pressure_mbar).max(initial=0.0)), 1e-9)
    scale = top / _TOP_BY_SCALE
    return scale, np.arcsinh(pressure_mbar / scale)


def _smooth(pressure_mbar: Array, deflection_mm: Array) -> tuple[float, _Chebyshev | None]:
    """Return a pressure and a polynomial of arcsinh(p / that), close to the curve."""
    scale, s = _places(pressure_mbar)
    # Of a square wave pressures are the same but for rounding: these are one place.
    degree = min(_DEGREE, len(np.unique(s.round(6))) - 2)
    while degree >= 1:
        smooth, (_, rank, *_) = _Chebyshev.fit(s, deflection_mm, degree, full=True)
        if int(rank) > degree:
            return scale, smooth
        degree = int(rank) - 1  # places so near to each other that they are fewer
    return scale, None
