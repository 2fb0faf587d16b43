"""Rounding to a step, which is found in the readings themselves.

Where the noise is above half a step, rounding is one more independent error of variance step²/12.
Below, its error is in part a function of the deflection itself, periodic with the step: the mean of
a reading at w, with Gaussian noise of σ before the rounding, is off by

    Σₖ (step/πk) exp(−2π²k²σ²/step²) (−1)ᵏ sin(2πkw/step)

(Widrow and Kollár 2008, Quantization Noise, chapters 4 and 15). The first of these waves are
columns, over the fitted deflections, their phases unknown since the fit is off by a little; only
what is left of step²/12 is independent. Taking all of it as independent makes intervals too wide
and calls the waves errors that last.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.error_models.base import Look, Part, Terms
from skinlab.inference.settings import KINDS

Array = NDArray[np.float64]


def step_um(deflection_mm: Array) -> float:
    """Return the step of the lattice on which all readings (u,) lie, µm; 0 where there is none."""
    return step_of(1e3 * deflection_mm, KINDS.step_um)


def step_of(readings: Array, least: float) -> float:
    """Return the same in the readings' own unit; a step below `least` is none."""
    levels = np.unique(np.round(readings, 6))
    if len(levels) < 2:
        return 0.0
    gaps = np.diff(levels)
    step = float(gaps.min())
    # Few different readings are a lattice only if each of them comes again and again.
    few = len(levels) < KINDS.step_levels and len(levels) * KINDS.step_again > len(readings)
    if step < least or few:
        return 0.0
    at = (levels - levels[0]) / step
    return step if float(np.abs(at - np.round(at)).max()) < KINDS.step_off else 0.0


@dataclass(frozen=True)
class Quantised:
    """Rounding of the deflection."""

    name: str = "quantised"
    meaning: str = "rounding to a step, which is found in the readings"
    prior: str = (
        "step²/12, of which a part goes with the deflection if the noise is below half a step"
    )

    def part(self, look: Look) -> Part | None:
        """Return its part where the readings lie on a lattice."""
        step = step_um(look.samples.deflection_mm)
        if not step:
            return None
        waves = _waves(look, 1e-3 * step)
        variance = (1e-3 * step) ** 2 / 12.0 - np.square(waves).sum(axis=1)

        def terms(values: Sequence[float]) -> Terms:
            del values
            return Terms(variance, columns_mm=waves if waves.shape[1] else None)

        return Part(
            "quantised", (), terms, always=True, stated={"step_um": step},
            why=f"readings come in steps of {step:g} µm",
        )  # fmt: skip


def wave_sizes(step_mm: float, before_mm2: float) -> list[tuple[int, float]]:
    """Return number and standard deviation, mm, of the waves that matter.

    `before_mm2` is the variance of the noise that the rounding met.
    """
    found = []
    for k in range(1, KINDS.step_waves + 1):
        damped = np.exp(-2.0 * (np.pi * k) ** 2 * before_mm2 / step_mm**2)
        size = step_mm / (np.pi * k) * damped / np.sqrt(2.0)
        if size > KINDS.step_least_wave * step_mm / np.sqrt(12.0):
            found.append((k, float(size)))
    return found


def in_waves(look: Look) -> bool:
    """Return whether rounding is in part a known function of the deflection."""
    step_mm = 1e-3 * step_um(look.samples.deflection_mm)
    return bool(step_mm) and bool(wave_sizes(step_mm, _before_mm2(look, step_mm)))


def _before_mm2(look: Look, step_mm: float) -> float:
    """Return the variance of the noise that the rounding met."""
    freedom = max(len(look.samples) - look.slopes.shape[1], 1)
    square = float(look.residual_mm @ look.residual_mm) / freedom
    return float(max(square - step_mm**2 / 12.0, 0.0))


def _waves(look: Look, step_mm: float) -> Array:
    """Return sine and cosine (u, 2 waves), each as large as its standard deviation, mm."""
    columns = []
    for k, size in wave_sizes(step_mm, _before_mm2(look, step_mm)):
        angle = 2.0 * np.pi * k * look.deflection_mm / step_mm
        columns += [size * np.sin(angle), size * np.cos(angle)]
    return np.column_stack(columns) if columns else np.zeros((len(look.samples), 0))


ERROR_MODEL = Quantised()
