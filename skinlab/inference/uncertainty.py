"""How sure an answer is: the posterior of the parameters, given the noise and a stated prior.

The prior is flat in the search space's own coordinates: for the shipped database log X1, log X2/X1
and ν over its whole range; a thickness with a standard deviation is Gaussian about the stated one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from skinlab.inference.joint import GaussianPrior, JointMisfit
from skinlab.inference.noise import (
    MESH_REST,
    NoiseEstimate,
    Whitening,
    judge,
    mesh_error_shapes,
    pressure_noise_mbar,
    slope_mm_per_mbar,
)
from skinlab.inference.posterior import Draws, sample
from skinlab.inference.problem import SquaredMisfit
from skinlab.inference.samples import Fitted, Group
from skinlab.mechanics.materials.compressibility import KappaConvention
from skinlab.parameters import Space
from skinlab.tables.base import CurveModel, Database

Array = NDArray[np.float64]

_MOST_MODES = 6
_UNLIKELY = 0.995  # a χ² above this quantile is a misfit that noise does not explain


@dataclass(frozen=True)
class Sensor:
    """Standard deviations of the sensors' noise; None: to be estimated from the curves."""

    noise_um: float | None = None
    pressure_noise_mbar: float | None = None


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """What is left open."""

    names: tuple[str, ...]  # of the parameters asked for; the thickness' ratio may follow them
    space: Space  # of the draws
    draws: Draws
    noise_um: float  # root mean square over samples, of one deflection sample's noise
    above_noise: bool  # the misfit is clearly more than the noise explains
    parts: tuple[SquaredMisfit, ...]  # whose sum is χ², Gaussian priors included
    relative_thickness_sd: float = 0.0


def assess(
    database: Database,
    kappa: KappaConvention,
    groups: Sequence[Group],
    models: Sequence[CurveModel],
    space: Space,
    minima: Array,
    sensor: Sensor,
    rng: np.random.Generator,
    *,
    priors: Sequence[GaussianPrior] = (),
) -> Uncertainty:
    """Return the posterior about the minima (m, k), points of the space's unit cube, best first.

    `models` are those of the groups at their stated thicknesses.
    """
    points = sum(len(g.deflection_mm) for g in groups)
    best = space.from_unit(minima[0])
    noises: list[tuple[NoiseEstimate, int]] = []
    parts: list[SquaredMisfit] = []
    # One skin has one thickness: its relative error is common to all its curves.
    relative_sd = max(g.thickness_sd_mm / g.geometry.thickness_mm for g in groups)
    factors: list[tuple[float, float]] = []
    for g, stated_model in zip(groups, models, strict=True):
        model = stated_model
        if relative_sd > 0.0:
            model = g.model(database, kappa, relative_sd)
            factors.append((float(model.space.bounds[0][-1]), float(model.space.bounds[1][-1])))
        at_best = model.deflection_mm((np.append(best, 1.0) if relative_sd > 0.0 else best)[None])[
            0
        ]
        found = noise_of_curves(g, at_best, points, sensor)
        noises += [(n, m.count) for n, m in zip(found, g.members, strict=True)]
        sigmas = np.concatenate(
            [np.full(m.count, 1e-3 * n.assumed_um) for n, m in zip(found, g.members, strict=True)]
        )
        sigma = np.hypot(sigmas, _other_errors(g, at_best, sensor))
        shapes = (mesh_error_shapes(g.pressure_mbar, at_best), model.error_shapes_mm)
        whitening = Whitening(sigma, np.hstack(shapes))
        parts.append(model.misfit(g.deflection_mm, whitening))
    names = space.names
    parts += priors
    modes = minima[:_MOST_MODES]
    if relative_sd > 0.0:
        low, high = max(f[0] for f in factors), min(f[1] for f in factors)
        space = space.extended("thickness_ratio", low, high)
        parts.append(GaussianPrior(len(best), 1.0, relative_sd))
        stated = space.to_unit(np.append(best, 1.0))[-1]
        modes = np.column_stack([modes, np.full(len(modes), stated)])
    total = JointMisfit(parts)
    least = float(total(space.from_unit(modes)).min())
    freedom = max(points - len(best), 1)
    above = any(n.above for n, _ in noises)
    factor = 1.0
    if least > chi2.ppf(_UNLIKELY, freedom):
        # The model misses something: the spread of the residual stands in for the noise, as is
        # customary (Birge 1932), and the flag says that the intervals mean less.
        above = True
        factor = least / freedom
    draws = sample(space, total, modes, rng, factor=factor)
    noise = np.sqrt(sum(n.value_um**2 * u for n, u in noises) / points)
    return Uncertainty(names, space, draws, float(noise), above, tuple(parts), relative_sd)


def noise_of_curves(g: Group, model_mm: Array, points: int, sensor: Sensor) -> list[NoiseEstimate]:
    """Return the deflection noise of each curve of a group, given its model (u,) at the best fit.

    `points` is the number of samples of the whole fit, on which three parameters were spent.
    """
    share = max(1.0 - 3.0 / points, 1.0 / points)
    other = g.split(_other_errors(g, model_mm, sensor))
    return [
        judge(residual, o, member.count * share, sensor.noise_um)
        for member, residual, o in zip(
            g.members, g.split(g.deflection_mm - model_mm), other, strict=True
        )
    ]


def _other_errors(g: Group, model_mm: Array, sensor: Sensor) -> Array:
    """Return standard deviations (u,), mm: the pressure's noise through dw/dp, and the mesh's."""
    slopes = g.split(slope_mm_per_mbar(g.pressure_mbar, model_mm))
    by_pressure = [
        slope * _pressure_noise(member, sensor)
        for member, slope in zip(g.members, slopes, strict=True)
    ]
    return np.hypot(np.concatenate(by_pressure), MESH_REST * model_mm)


def _pressure_noise(member: Fitted, sensor: Sensor) -> float:
    if sensor.pressure_noise_mbar is not None:
        return sensor.pressure_noise_mbar
    curve, mask = member.curve, member.mask
    return pressure_noise_mbar(curve.time_s[mask], curve.pressure_mbar[mask])
