"""Rounding to a step, which is found in the readings themselves.

Where the noise is above half a step, rounding is one more independent error of variance step²/12.
Below, its error is in part a function of the deflection itself, periodic with the step: the mean of
a reading at w, with Gaussian noise of σ before the rounding, is off by

    Σₖ (step/πk) exp(−2π²k²σ²/step²) (−1)ᵏ sin(2πkw/step)

(Widrow and Kollár 2008, Quantization Noise, chapters 4 and 15). The first of these waves are
columns, over the fitted deflections, their phases unknown since the fit is off by a little; only
what is left of step²/12 is independent. Taking all of it as independent makes intervals too wide
and calls the waves errors that last.

Of several curves each has its own lattice, and its own phases: zeros of placements are between the
steps (docs/decisions/0172-steps-curve-by-curve.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinlab.inference.covariance import block_diagonal
from skinlab.inference.error_models.base import Look, Part, Terms
from skinlab.inference.noise import roughness
from skinlab.inference.samples import Samples
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


def steps_of_curves_um(samples: Samples) -> list[float]:
    """Return the step of the lattice of each curve's readings, µm; 0 where there is none.

    What a curve's own readings are too few to tell, others' steps tell: it lies on their lattice
    from an origin of its own.
    """
    curves = np.split(1e3 * samples.deflection_mm, samples.ends[:-1])
    own = [step_of(readings, KINDS.step_um) for readings in curves]
    if len(own) == 1:
        return own
    known: list[float] = []  # of steps that are the same but for the last digits the first
    for step in (step_um(samples.deflection_mm), *own):
        if step and not any(_same(step, one) for one in known):
            known.append(step)
    known.sort(reverse=True)
    found = []
    for readings, step in zip(curves, own, strict=True):
        fits = (one for one in known if (_same(step, one) if step else _lies_on(readings, one)))
        found.append(next(fits, 0.0))
    return found


def steps_of_samples_mm(samples: Samples) -> Array:
    """Return the same of the curve of each sample (u,), mm."""
    return 1e-3 * np.array([*steps_of_curves_um(samples), 0.0])[samples.curve]


def _same(step: float, other: float) -> bool:
    return abs(step - other) <= 1e-6 * other


def _lies_on(readings: Array, step: float) -> bool:
    """Return whether readings lie on a lattice of this step: two levels at least."""
    levels = np.unique(np.round(readings, 6))
    at = (levels - levels[:1]) / step
    return len(levels) > 1 and float(np.abs(at - np.round(at)).max()) < KINDS.step_off


@dataclass(frozen=True)
class Quantised:
    """Rounding of the deflection."""

    name: str = "quantised"
    meaning: str = "rounding to a step, which is found in each curve's readings"
    prior: str = (
        "step²/12, of which a part goes with the deflection if the noise is below half a step"
    )

    def part(self, look: Look) -> Part | None:
        """Return its part where the readings of a curve lie on a lattice."""
        steps = steps_of_curves_um(look.samples)
        if not any(steps):
            return None
        curves = np.split(look.deflection_mm, look.samples.ends[:-1])
        waves = [
            _waves(w, 1e-3 * step, before)
            for w, step, before in zip(curves, steps, _before_mm2(look, steps), strict=True)
        ]
        variance = np.concatenate(
            [
                (1e-3 * step) ** 2 / 12.0 - np.square(own).sum(axis=1)
                for step, own in zip(steps, waves, strict=True)
            ]
        )
        return rounding(steps, variance, block_diagonal(waves))


def rounding(steps_um: Sequence[float], variance_mm2: Array, columns_mm: Array) -> Part:
    """Return the part of curves with these steps, 0 of one without, as it is told."""

    def terms(values: Sequence[float]) -> Terms:
        del values
        return Terms(variance_mm2, columns_mm=columns_mm if columns_mm.shape[1] else None)

    some = [step for step in steps_um if step]
    words = " and ".join(sorted({f"{step:g}" for step in some}, key=float))
    whose = "" if len(some) == len(steps_um) else f" of {len(some)} of {len(steps_um)} curves"
    return Part(
        "quantised", (), terms, always=True, stated={"step_um": min(some)},
        why=f"readings{whose} come in steps of {words} µm",
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
    """Return whether rounding is in part a known function of the deflection, in some curve."""
    steps = steps_of_curves_um(look.samples)
    each = zip(steps, _before_mm2(look, steps), strict=True)
    return any(step and wave_sizes(1e-3 * step, before) for step, before in each)


def _before_mm2(look: Look, steps_um: Sequence[float]) -> list[float]:
    """Return the variance of the noise that the rounding of each curve met.

    Of several curves no more than is rough: what placements do is no noise of a reading.
    """
    freedom = max(len(look.samples) - look.slopes.shape[1], 1)
    square = float(look.residual_mm @ look.residual_mm) / freedom
    if len(steps_um) == 1:
        squares = [square]
    else:
        rough = map(roughness, np.split(look.residual_mm, look.samples.ends[:-1]))
        squares = [square if np.isnan(r) else min(square, r**2) for r in rough]
    return [
        float(max(one - (1e-3 * step) ** 2 / 12.0, 0.0))
        for one, step in zip(squares, steps_um, strict=True)
    ]


def _waves(deflection_mm: Array, step_mm: float, before_mm2: float) -> Array:
    """Return sine and cosine (n, 2 waves), each as large as its standard deviation, mm."""
    columns = []
    for k, size in wave_sizes(step_mm, before_mm2) if step_mm else []:
        angle = 2.0 * np.pi * k * deflection_mm / step_mm
        columns += [size * np.sin(angle), size * np.cos(angle)]
    return np.column_stack(columns) if columns else np.zeros((len(deflection_mm), 0))


ERROR_MODEL = Quantised()
