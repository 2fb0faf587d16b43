"""What stands between a perfect model and a measured curve: sensor noise, and the mesh.

Errors of one curve: independent ones with σ_i² = noise² + (dw/dp · pressure noise)² + (mesh rest)²,
and a few shapes in which the model's own discretisation errs as a whole.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, t

Array = NDArray[np.float64]

# Root mean squares of the relative deviation of the mesh of record from a fine mesh, by orders of
# shifted Legendre polynomials of p/p_max, and of the rest: `python benchmarks/model_error.py`, of
# other 64 skins than benchmarks/results/model_error.json, whose first two are 4 to 6 % larger.
MESH_ERROR = (9.0e-4, 3.2e-4, 1.3e-4, 1.0e-4, 8.0e-5, 4.5e-5, 3.5e-5, 3.5e-5)
MESH_REST = 1.0e-5

TABLE_UM = 0.01  # interpolation in the database, and the least noise there is
_LEAST_PRESSURE_NOISE_MBAR = 0.02  # less is rounding
_FEWEST = 12  # samples from which a noise is judged by its roughness
_UNREMARKABLE_UM = 0.15  # no sensor is that good: smaller misfits are the mesh's and the table's
_SIGNIFICANT = 4.0  # ln(rms²/roughness²) of white noise is below 4/√u in 99 % of curves


def legendre(x: Array, orders: int) -> Array:
    """Return shifted Legendre polynomials (n, orders) at x (n,) in 0…1, of mean square 1."""
    scale = np.sqrt(2.0 * np.arange(orders) + 1.0)
    return np.asarray(np.polynomial.legendre.legvander(2.0 * x - 1.0, orders - 1) * scale)


@dataclass(frozen=True, eq=False)
class Whitening:
    """W with WᵀW = Σ⁻¹, for Σ = diag(σ²) + V Vᵀ: independent errors and a few shapes."""

    sigma_mm: Array  # (u,)
    shapes_mm: Array  # V (u, m), each as large as its standard deviation

    def __call__(self, curves_mm: Array) -> Array:
        """Return W applied to curves (u, …)."""
        flat = curves_mm.reshape(len(curves_mm), -1) / self.sigma_mm[:, None]
        q, s, _ = np.linalg.svd(self.shapes_mm / self.sigma_mm[:, None], full_matrices=False)
        flat = flat + q @ ((1.0 / np.sqrt(1.0 + s**2) - 1.0)[:, None] * (q.T @ flat))
        return np.asarray(flat.reshape(curves_mm.shape))


def mesh_error_shapes(pressure_mbar: Array, deflection_mm: Array) -> Array:
    """Return the shapes (u, m), mm, in which the model's own discretisation errs."""
    top = max(float(pressure_mbar.max(initial=0.0)), 1e-9)
    x = np.clip(pressure_mbar / top, 0.0, 1.0)
    return np.asarray(legendre(x, len(MESH_ERROR)) * np.array(MESH_ERROR) * deflection_mm[:, None])


def roughness(values: Array) -> float:
    """Return the standard deviation of what in values (n,) is as rough as white noise.

    From second differences, which a smooth course hardly has; NaN below 3 values.
    """
    if len(values) < 3:
        return float("nan")
    bend = values[1:-1] - 0.5 * (values[:-2] + values[2:])
    return float(np.sqrt(np.mean(bend**2) / 1.5))


def pressure_noise_mbar(time_s: Array, pressure_mbar: Array) -> float:
    """Return the standard deviation of the noise in a pressure channel (n,), mbar.

    Each reading is compared with the cubic through its four neighbours in time, which a pump's
    course follows closely, and with the reading before, which steps of a program leave alone; by
    the median, so that corners do not count.
    """
    n = len(time_s)
    if n < _FEWEST:
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
    found = min(float(np.median(misses)), float(np.median(steps))) / float(norm.ppf(0.75))
    return found if found >= _LEAST_PRESSURE_NOISE_MBAR else 0.0


def slope_mm_per_mbar(pressure_mbar: Array, deflection_mm: Array) -> Array:
    """Return dw/dp (u,) of a smooth curve given at pressures in any order, within about 1 %."""
    top = max(float(np.abs(pressure_mbar).max(initial=0.0)), 1e-9)
    scale = top / 20.0
    s = np.arcsinh(pressure_mbar / scale)
    degree = min(8, len(np.unique(s)) - 2)
    if degree < 1:
        return np.zeros(len(s))
    smooth = np.polynomial.Chebyshev.fit(s, deflection_mm, degree)
    return np.asarray(smooth.deriv()(s) / np.hypot(pressure_mbar, scale))


@dataclass(frozen=True)
class NoiseEstimate:
    """Noise of one deflection sample, µm, as `value`; `above` where the misfit is clearly more."""

    value_um: float  # stated, or estimated: what a perfect model would leave
    assumed_um: float  # with which intervals are drawn: wider where the misfit is above
    above: bool


def judge(
    residual_mm: Array, other_mm: Array, freedom: float, stated_um: float | None
) -> NoiseEstimate:
    """Return the deflection noise of one curve, given its residuals (u,) in the order of time.

    `other_mm` (u,) are the standard deviations of errors other than this noise; `freedom` the
    number of samples less that of the parameters they were spent on.
    """
    u = len(residual_mm)
    other = float(np.mean(other_mm**2))
    total = float(residual_mm @ residual_mm) / max(freedom, 1.0)
    least = (1e-3 * TABLE_UM) ** 2
    spread = max(total - other, least)
    if stated_um is not None:
        variance = max((1e-3 * stated_um) ** 2, least)
        return NoiseEstimate(stated_um, 1e3 * float(np.sqrt(variance)), above=False)
    # The estimate has an uncertainty itself: Student's quantile against Gauss's at 90 %.
    wider = float(t.ppf(0.95, max(freedom, 1.0)) / norm.ppf(0.95))
    assumed = 1e3 * wider * float(np.sqrt(spread))
    value = 1e3 * float(np.sqrt(spread))
    if u < _FEWEST:
        return NoiseEstimate(value, assumed, above=False)
    rough = max(roughness(residual_mm) ** 2 - other, least)
    above = total > (1e-3 * _UNREMARKABLE_UM) ** 2 and total / (rough + other) > np.exp(
        _SIGNIFICANT / np.sqrt(u)
    )
    if above:
        value = 1e3 * float(np.sqrt(rough))
    return NoiseEstimate(value, assumed, bool(above))
