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
from skinlab.inference.error_models.quantised import wave_sizes

Array = NDArray[np.float64]


def models_of(records: Sequence[Record], thickness_mm: Array) -> list[ErrorModel]:
    """Return the kinds of errors that a campaign may have."""
    absent = ERRORS.placements_alike if _repeated(records) else 0.0
    rounded = _rounded(records)
    own: list[ErrorModel] = [] if rounded is None else [rounded]
    others = {Placement.name} | {model.name for model in own}
    return [
        *(model for model in ERROR_MODELS.all() if model.name not in others),
        *own,
        Placement(absent, lone_zero=True),
        ThicknessScatter(thickness_mm, absent),
        Wander(),
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


@dataclass(frozen=True, eq=False)
class RoundedMeans:
    """Rounding of samples that were averaged: a step they have no more, but its wave is left.

    A mean of rounded readings is off by the wave of `quantised`, averaged over the heights that
    went into it. Each curve has a phase of its own: placements differ by more than a step.
    """

    step_mm: float
    before_mm: float  # noise of a reading that the rounding met
    name: str = "quantised"
    meaning: str = "rounding of readings that were averaged"
    prior: str = "as that of single readings, averaged"

    def part(self, look: Look) -> Part | None:
        """Return its part."""
        curve, w = look.samples.curve, look.deflection_mm
        edges = np.flatnonzero(np.diff(curve)) + 1
        span = np.concatenate(
            [
                np.abs(np.gradient(part)) if len(part) > 1 else 0.0 * part
                for part in np.split(w, edges)
            ]
        )
        own = (curve[:, None] == np.unique(curve)).astype(float)
        columns, taken = [], 0.0
        for k, size in wave_sizes(self.step_mm, self.before_mm**2):
            left = size * np.sinc(k * span / self.step_mm)
            angle = 2.0 * np.pi * k * w / self.step_mm
            columns += [own * (left * wave)[:, None] for wave in (np.sin(angle), np.cos(angle))]
            taken += size**2
        variance = (self.step_mm**2 / 12.0 - taken) * look.samples.relative_noise**2
        waves = np.hstack(columns) if columns else None

        def terms(values: Sequence[float]) -> Terms:
            del values
            return Terms(variance, columns_mm=waves)

        step_um = 1e3 * self.step_mm
        return Part(
            "quantised", (), terms, always=True, stated={"step_um": step_um},
            why=f"readings come in steps of {step_um:g} µm",
        )  # fmt: skip


def _rounded(records: Sequence[Record]) -> RoundedMeans | None:
    """Return the rounding of what was averaged; None where nothing was, or no step is known."""
    first = max(records, key=lambda r: r.coarse)
    step_um = min((r.step_um for r in records), default=0.0)
    if first.coarse < 2 or not step_um:
        return None
    square = first.noise_um**2 * first.coarse
    if not first.noise_is_stated:
        square = max(square - step_um**2 / 12.0, 0.0)
    return RoundedMeans(1e-3 * step_um, 1e-3 * math.sqrt(square))


@dataclass(frozen=True)
class Wander:
    """The zero of each curve wanders: the weight of the probe, tape that creeps.

    A random walk (0.5 to 1 µm per root second): beside errors that last for a while it is what
    grows with the time of a curve. Its first terms by Karhunen and Loève hold 90 % of it and more.
    """

    name: str = "wander"
    meaning: str = "the zero wanders during a curve, a random walk"
    prior: str = "0.7 µm per root second, 0.6 below and 0.45 above; as likely there as not"

    def part(self, look: Look) -> Part:
        """Return its part."""
        samples = look.samples
        shapes = [walk_shapes(t) for t in np.split(samples.time_s, samples.ends[:-1])]
        columns = 1e-3 * block_diagonal(shapes)

        def terms(values: Sequence[float]) -> Terms:
            return Terms(columns_mm=columns, sizes=np.full(columns.shape[1], values[0]))

        median, below, above = ERRORS.wander
        size = Hyperparameter("wander_um_per_root_s", median, below, log_sd_above=above)
        return Part(self.name, (size,), terms, lasting=True, why="zeros wander during curves")


def walk_shapes(time_s: Array) -> Array:
    """Return the first terms (n, m) of a random walk of 1 per root second from its first time on.

    Each is as large as its standard deviation (Karhunen and Loève). A longer curve has more: what
    is left out, 2/(π²m) of its mean square, grows with the time.
    """
    t = time_s - time_s[0]
    whole_s = max(float(t[-1]), 1e-9)
    terms = max(ERRORS.wander_terms, math.ceil(whole_s / ERRORS.wander_each_s))
    odd = (np.arange(terms) + 0.5) * np.pi
    return np.asarray(math.sqrt(2.0 * whole_s) / odd * np.sin(np.outer(t / whole_s, odd)))
