"""The kinds of errors that a campaign may have beside those of a single curve."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinlab.discrepancy.records import Record, by_condition
from skinlab.discrepancy.settings import ERRORS
from skinlab.inference.covariance import block_diagonal
from skinlab.inference.error_models import ERROR_MODELS
from skinlab.inference.error_models.base import ErrorModel, Hyperparameter, Look, Part, Terms
from skinlab.inference.error_models.placement import Placement
from skinlab.inference.error_models.quantised import rounding, step_um, wave_sizes
from skinlab.inference.error_models.wander import Wander

Array = NDArray[np.float64]

WANDER = Wander(ERRORS.wander_terms, ERRORS.wander_each_s, most_terms=None, fewest_samples=0)


def models_of(records: Sequence[Record], thickness_mm: Array) -> list[ErrorModel]:
    """Return the kinds of errors that a campaign may have."""
    absent = ERRORS.placements_alike if _repeated(records) else 0.0
    rounded = _rounded(records)
    own: list[ErrorModel] = [] if rounded is None else [rounded]
    others = {Placement.name, Wander.name} | {model.name for model in own}
    return [
        *(model for model in ERROR_MODELS.all() if model.name not in others),
        *own,
        Placement(absent, lone_zero=True),
        ThicknessScatter(thickness_mm, absent),
        WANDER,
    ]


def _repeated(records: Sequence[Record]) -> bool:
    """Return whether a condition was measured at several placements."""
    groups = by_condition(records)
    return any(len({records[i].placement for i in members}) > 1 for members in groups)


@dataclass(frozen=True, eq=False)
class ThicknessScatter:
    """Each site where the probe is put on is a little thicker or thinner: an error model."""

    slope_mm: Array  # (u,) dw/d(log thickness)
    absent: float = 0.0  # share of the prior with which sites hardly differ
    name: str = "placement_thickness"
    meaning: str = "the skin's thickness differs from placement to placement"
    prior: str = "2 %, 0.8 below and 0.45 above; always there"

    def part(self, look: Look) -> Part | None:
        """Return its part for several placements, unless there is said to be no scatter."""
        numbers = np.unique(look.samples.placement)
        if look.placement_scatter == 0.0 or len(numbers) < 2:
            return None
        one = (look.samples.placement[:, None] == numbers).astype(float)
        columns = self.slope_mm[:, None] * one

        def terms(values: Sequence[float]) -> Terms:
            return Terms(columns_mm=columns, sizes=np.full(columns.shape[1], values[0]))

        median, below, above = ERRORS.thickness_scatter
        size = Hyperparameter(self.name, median, below, log_sd_above=above, absent=self.absent)
        return Part(self.name, (size,), terms, always=True)


@dataclass(frozen=True)
class Rounding:
    """Rounding of the readings of one curve."""

    step_mm: float  # 0: there is none
    before_mm: float  # noise of a reading that the rounding met
    averaged: bool

    @classmethod
    def of(cls, record: Record) -> Rounding:
        """Return it. Means have no step any more; readings that are still there have."""
        averaged = record.coarse > 1
        step = record.step_um if averaged else step_um(record.curve.deflection_mm)
        square = record.noise_um**2 * record.coarse
        if not record.noise_is_stated:
            square = max(square - step**2 / 12.0, 0.0)
        return cls(1e-3 * step, 1e-3 * math.sqrt(square), averaged)

    def waves(self, deflection_mm: Array) -> tuple[Array, float]:
        """Return what goes with the deflection (n, m), and the variance that this is of a reading.

        A mean of readings is off by the wave averaged over the heights that went into it.
        """
        span = np.zeros_like(deflection_mm)
        if self.averaged and len(span) > 1:
            span = np.abs(np.gradient(deflection_mm))
        columns, taken = [], 0.0
        sizes = wave_sizes(self.step_mm, self.before_mm**2) if self.step_mm else []
        for k, size in sizes:
            left = size * np.sinc(k * span / self.step_mm)
            angle = 2.0 * np.pi * k * deflection_mm / self.step_mm
            columns += [left * np.sin(angle), left * np.cos(angle)]
            taken += size**2
        return np.array(columns).reshape(-1, len(span)).T, taken


@dataclass(frozen=True, eq=False)
class RoundedMeans:
    """Rounding of samples some of which were averaged: `quantised`, of each curve by itself.

    Each curve has a phase of its own: placements differ by more than a step.
    """

    each: tuple[Rounding, ...]  # of the curves
    name: str = "quantised"
    meaning: str = "rounding of readings that were averaged"
    prior: str = "as that of single readings, averaged"

    def part(self, look: Look) -> Part:
        """Return its part."""
        samples = look.samples
        curves = np.split(look.deflection_mm, samples.ends[:-1])
        found = [one.waves(w) for one, w in zip(self.each, curves, strict=True)]
        alone = [
            np.full(len(w), one.step_mm**2 / 12.0 - taken)
            for one, w, (_, taken) in zip(self.each, curves, found, strict=True)
        ]
        variance = np.concatenate(alone) * samples.relative_noise**2
        columns = block_diagonal([waves for waves, _ in found])

        steps = [float(f"{1e3 * one.step_mm:g}") for one in self.each]
        return rounding(steps, variance, columns)


def _rounded(records: Sequence[Record]) -> RoundedMeans | None:
    """Return the rounding of what was averaged; None where nothing was, or no step is known."""
    each = tuple(Rounding.of(r) for r in records)
    if not any(one.averaged for one in each) or not any(one.step_mm for one in each):
        return None
    return RoundedMeans(each)


def walk_shapes(time_s: Array) -> Array:
    """Return the terms (n, m) of a random walk of 1 per root second that a campaign's curve has."""
    return WANDER.shapes(time_s)
