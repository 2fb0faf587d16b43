"""The curves that are identified: the blind test, the stand-in for Figure 3, and many skins.

All have 51 samples from 0 to 100 mbar (the paper: 50 to 100), of a 6 mm opening.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.problem import Problem
from skinlab.mechanics.fem.suction import Geometry
from skinlab.reproduction.published_values import PAPER_BOX
from skinlab.tables.evaluator import Evaluator
from skinlab.tables.store import shipped_grid, shipped_table

Array = NDArray[np.float64]

PRESSURE_MBAR = np.linspace(0.0, 100.0, 51)
SKIN = Geometry(6.0, 1.0)  # 1 mm is assumed for everybody, as in the paper

BLIND_TRUTH = (0.03, 1.0, 0.32)  # section 3.1
STAND_IN_TRUTH = (0.026, 3.1, 0.26)  # Table 2, N = 1000

# The sensor, as the simulated probe has it.
NOISE_MM, RESOLUTION_MM = 3e-3, 1e-3
PRESSURE_NOISE_MBAR, PRESSURE_RESOLUTION_MBAR = 0.2, 0.1

MISFIT_RMS_MM = 14e-3  # makes E 2 µm with 51 samples: 14.3 µm / √51
_MISFIT_WAVES = 2.0
STAND_IN_NOISE_SEED = 3

RECIPE = f"""\
Figure 3's points are not at hand, so a **stand-in** takes their place: the model of the paper's
grid at Table 2's values for N = 1000, X1 = {STAND_IN_TRUTH[0]:g} MPa, X2 = {STAND_IN_TRUTH[1]:g}
MPa, ν = {STAND_IN_TRUTH[2]:g}, at p = 0, 2, …, 100 mbar (51 samples); plus a smooth misfit −s(p),
where s is sin({2 * _MISFIT_WAVES:g}π p / 100 mbar) less what changes of X1, X2 and ν could explain
(its projection on the three slopes ∂Ω/∂x there), scaled to {1e3 * MISFIT_RMS_MM:g} µm root mean
square; plus Gaussian noise of {1e3 * NOISE_MM:g} µm (numpy's
`default_rng({STAND_IN_NOISE_SEED})`, whatever the seed of the rest); rounded to
{1e3 * RESOLUTION_MM:g} µm. This leaves E ≈ 2 µm at the best fit, as in Table 2, and the best fit
near Table 2's values. The misfit's form is made up; what depends on it is said below."""


@dataclass(frozen=True)
class Blind:
    """A curve taken from the simulated space itself (section 3.1)."""

    def measured(self) -> tuple[Array, Array]:
        """Return pressures, mbar, and the model's own deflections, mm, (51,) each."""
        return PRESSURE_MBAR, _model_mm(BLIND_TRUTH)


@dataclass(frozen=True)
class StandIn:
    """The stand-in for Figure 3's curve; RECIPE says what it is."""

    noise_seed: int = STAND_IN_NOISE_SEED

    def measured(self) -> tuple[Array, Array]:
        """Return the model plus a smooth misfit and noise."""
        noise = np.random.default_rng(self.noise_seed).normal(0.0, NOISE_MM, PRESSURE_MBAR.size)
        values = _model_mm(STAND_IN_TRUTH) + smooth_misfit_mm() + noise
        return PRESSURE_MBAR, _rounded(values, RESOLUTION_MM)


@dataclass(frozen=True)
class Skin:
    """One of the skins of Figure 13, with parameters and a thickness of its own."""

    seed: int
    number: int

    def truth(self) -> tuple[Array, float]:
        """Return (X1, X2, ν) and the thickness in mm."""
        parameters, thickness, _ = self._drawn()
        return parameters, thickness

    def measured(self) -> tuple[Array, Array]:
        """Return the curve as the sensor reads it."""
        _, _, curve = self._drawn()
        rng = np.random.default_rng([self.seed, self.number, 1])
        deflection = curve + rng.normal(0.0, NOISE_MM, curve.size)
        pressure = PRESSURE_MBAR + rng.normal(0.0, PRESSURE_NOISE_MBAR, curve.size)
        return (
            _rounded(pressure, PRESSURE_RESOLUTION_MBAR),
            _rounded(deflection, RESOLUTION_MM),
        )

    def _drawn(self) -> tuple[Array, float, Array]:
        """Return parameters, thickness and the true curve; drawn again where the skin creases."""
        rng = np.random.default_rng([self.seed, self.number])
        low, high = PAPER_BOX.bounds
        while True:
            scatter = np.exp(0.3 * rng.normal(size=2))
            x = np.array([0.025 * scatter[0], 3.0 * scatter[1], rng.uniform(0.22, 0.46)])
            thickness = float(rng.uniform(0.8, 1.6))
            if ((x < low) | (x > high)).any():
                continue
            model = shipped_table().model(Geometry(6.0, thickness), PRESSURE_MBAR)
            curve = model.ended().deflection_mm(x[None])[0]
            if np.isfinite(curve).all():
                return x, thickness, curve


Case = Blind | StandIn | Skin  # each rebuilt from its fields in every process


def paper_grid(pressure_mbar: Array) -> Evaluator:
    """Return the paper's grid as the paper had it: a skin ends where it creases."""
    return shipped_grid().model(SKIN, pressure_mbar).ended()


@lru_cache(maxsize=8)
def problem(case: Case) -> Problem:
    """Return the problem in the paper's box, on the paper's grid."""
    pressure, deflection = case.measured()
    model = paper_grid(pressure)
    return Problem(PAPER_BOX, model.misfit(deflection), len(pressure))


def smooth_misfit_mm() -> Array:
    """Return the stand-in's misfit (51,), mm: no change of the parameters explains any of it."""
    model = paper_grid(PRESSURE_MBAR)
    x, steps = np.array(STAND_IN_TRUTH), 1e-6 * np.array([0.09, 4.8, 0.28])
    shifts = np.diag(steps)
    rise = model.deflection_mm(x + shifts) - model.deflection_mm(x - shifts)
    slopes = (rise / (2.0 * steps[:, None])).T
    wave = np.sin(2.0 * np.pi * _MISFIT_WAVES * PRESSURE_MBAR / 100.0)
    wave -= slopes @ np.linalg.lstsq(slopes, wave, rcond=None)[0]
    return np.asarray(-wave * MISFIT_RMS_MM / np.sqrt(np.mean(wave**2)))


def model_mm(parameters: Array) -> Array:
    """Return the grid's curves (n, 51), mm, of candidates (n, 3)."""
    return np.asarray(paper_grid(PRESSURE_MBAR).deflection_mm(parameters))


def _model_mm(parameters: tuple[float, float, float]) -> Array:
    return np.asarray(model_mm(np.array([parameters]))[0])


def _rounded(values: Array, resolution: float) -> Array:
    return np.asarray(resolution * np.round(values / resolution))
