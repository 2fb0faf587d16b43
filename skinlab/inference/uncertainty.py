"""How sure an answer is: the posterior of the parameters, errors' parameters integrated out.

The prior is flat in the search space's own coordinates: for the shipped database log X1, log X2/X1
and ν over its whole range; a thickness with a standard deviation is Gaussian about the stated one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinlab.curves import corrected
from skinlab.curves.curve import Curve
from skinlab.curves.probe_file import ProbeErrors
from skinlab.inference.covariance import Covariance, OnKept, block_diagonal
from skinlab.inference.error_choice import ErrorChoice, choose_errors
from skinlab.inference.error_judgement import Judged, judge_errors
from skinlab.inference.error_models.base import ErrorModel, Look
from skinlab.inference.error_models.placement import expected_sizes
from skinlab.inference.error_models.quantised import steps_of_curves_um, steps_of_samples_mm
from skinlab.inference.joint import GaussianPrior, JointMisfit
from skinlab.inference.likelihood import LinearModel
from skinlab.inference.marginal import IntegratedLikelihood
from skinlab.inference.methods.auto import identify as search_everywhere
from skinlab.inference.noise import (
    MESH_REST,
    held,
    jumps,
    locking_shapes,
    mesh_error_shapes,
    pressure_error_mm,
    pressure_noise_mbar,
    roughness,
    slope_mm_per_mbar,
)
from skinlab.inference.optimise import polish
from skinlab.inference.outliers import outlier_probability
from skinlab.inference.posterior import FLAT_PRECISION, Draws, sample
from skinlab.inference.problem import Options, Problem, SquaredMisfit
from skinlab.inference.samples import Group, Samples, samples_of
from skinlab.inference.settings import NOISE, POSTERIOR, STARTS
from skinlab.mechanics.materials.compressibility import KappaConvention
from skinlab.parameters import ParameterSpace, Space
from skinlab.tables.base import CurveModel, Database

Array = NDArray[np.float64]

_SLOPE_STEP = 1e-4  # of the unit cube
_PRESSURE_STEP = 1e-3  # of the highest pressure


@dataclass(frozen=True)
class Sensor:
    """Standard deviations of the sensors' noise; None: to be estimated from the curves."""

    noise_um: float | None = None
    pressure_noise_mbar: float | None = None
    placement_scatter: float | None = None  # of log stiffness, of curves together; 0: there is none
    probe: ProbeErrors | None = None  # as it was calibrated; None: it reads the truth

    def corrected(self, curve: Curve) -> Curve:
        """Return a curve as it truly was, as far as this probe's calibration knows, or its own.

        Raises:
            InputError: it is of another opening than the probe.
        """
        probe = self.probe or curve.probe
        return curve if probe is None or curve.corrected_by else corrected.corrected(curve, probe)


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """What is left open."""

    names: tuple[str, ...]  # of the parameters asked for; the thickness' ratio may follow them
    space: Space  # of the draws
    draws: Draws
    errors: Judged
    parts: tuple[SquaredMisfit, ...]  # whose sum is χ², Gaussian priors included
    relative_thickness_sd: float = 0.0
    pressure_noise_mbar: float = 0.0  # of a reading, as it was stated or found; the curves' median

    @property
    def thickness_is_cut(self) -> bool:
        """Whether the database ends where the thickness may still be: intervals are too narrow."""
        if self.relative_thickness_sd <= 0.0:
            return False
        low, high = (float(end[-1]) for end in self.space.bounds)
        return min(1.0 - low, high - 1.0) < POSTERIOR.thickness_within * self.relative_thickness_sd


@dataclass(frozen=True)
class Elsewhere:
    """Asks a database for the model of a group at other pressures than its samples'."""

    database: Database
    kappa: KappaConvention

    def _deflections_mm(self, g: Group, parameters: Array, pressures_mbar: Array) -> Array:
        """Return the deflections (m, u) of parameters (p,), at the samples' times.

        A stated thickness stands behind the parameters of the model: the stated one is taken.
        """
        times = np.tile(g.time_s, len(pressures_mbar))
        there = replace(g, pressure_mbar=pressures_mbar.ravel(), time_s=times)
        model = there.model(self.database, self.kappa)
        found = model.deflection_mm(parameters[None, : len(model.space)])
        return np.asarray(found.reshape(pressures_mbar.shape))

    def slope_mm_per_mbar(self, g: Group, parameters: Array) -> Array:
        """Return dw/dp (u,) of the model there, a difference about each pressure.

        One-sided at the top and at zero: there may be no model beyond.
        """
        p = g.pressure_mbar
        ends = np.clip(p + _PRESSURE_STEP * p.max() * np.array([[-1.0], [1.0]]), *_reach(p))
        low, high = self._deflections_mm(g, parameters, ends)
        return np.asarray((high - low) / np.maximum(ends[1] - ends[0], 1e-12))

    def pressure_error_mm(self, g: Group, parameters: Array, sd_mbar: Array) -> Array:
        """Return what `noise.pressure_error_mm` does, of the model, straight beyond its ends."""
        p = g.pressure_mbar
        there = p + np.sqrt(3.0) * sd_mbar * np.array([[-1.0], [0.0], [1.0]])
        near = np.clip(there, *_reach(p))
        low, here, high = self._deflections_mm(g, parameters, near)
        beyond = self.slope_mm_per_mbar(g, parameters) * (there - near)
        squares = np.square(low + beyond[0] - here) + np.square(high + beyond[2] - here)
        return np.asarray(np.sqrt(squares / 6.0))


def _reach(pressure_mbar: Array) -> tuple[float, float]:
    """Return from where to where a group's model has to hold."""
    return min(float(pressure_mbar.min()), 0.0), float(pressure_mbar.max())


@dataclass(frozen=True, eq=False)
class Fitted:
    """All curves' samples with a fit to them, and which of the samples belong."""

    groups: Sequence[Group]
    models: Sequence[CurveModel]
    space: ParameterSpace
    samples: Samples
    parameters: Array  # (p,) of the fit
    best_mm: Array  # (u,) of the model there
    linear: LinearModel
    sensor: Sensor
    elsewhere: Elsewhere | None = None

    @cached_property
    def slope_mm_per_mbar(self) -> Array:
        """Return dw/dp (u,) at the fit.

        Of the curve through its values at the samples, or, where the pressure was held, of the
        model itself: two levels of a square wave tell no slope.
        """
        parts = []
        for g, w in zip(self.groups, split_by_group(self.groups, self.best_mm), strict=True):
            if self.elsewhere is not None and held(g.pressure_mbar):
                parts.append(self.elsewhere.slope_mm_per_mbar(g, self.parameters))
            else:
                parts.append(slope_mm_per_mbar(g.pressure_mbar, w))
        return np.concatenate(parts)

    @cached_property
    def pressure_error_mm(self) -> Array:
        """Return what the pressure readings' noise does to the deflections (u,)."""
        sd = self.pressure_sd_mbar()
        if not sd.any():
            return sd
        each = [split_by_group(self.groups, v) for v in (self.best_mm, sd)]
        parts = []
        for g, w, noise in zip(self.groups, *each, strict=True):
            if self.elsewhere is not None and held(g.pressure_mbar):
                parts.append(self.elsewhere.pressure_error_mm(g, self.parameters, noise))
            else:
                parts.append(pressure_error_mm(g.pressure_mbar, w, noise))
        return np.concatenate(parts)

    def mesh_columns(self) -> Array:
        """Return the shapes (u, m) in which mesh and database err.

        Of each group for itself; but the mesh locks under all openings alike.
        """
        blocks, locks = [], []
        for g, model, w in zip(
            self.groups, self.models, split_by_group(self.groups, self.best_mm), strict=True
        ):
            own = model.error_shapes_mm(self.parameters)
            blocks.append(np.hstack([mesh_error_shapes(g.pressure_mbar, w), own]))
            size = model.locking(self.parameters[None])[0]
            locks.append(size * locking_shapes(g.pressure_mbar, w))
        columns = np.hstack([block_diagonal(blocks), np.vstack(locks)])
        return columns[:, columns.any(axis=0)]  # most skins do not crease

    def probe_columns(self) -> Array:
        """Return what the probe's calibration leaves open (u, m): all samples err together."""
        curves = [member.samples for g in self.groups for member in g.members]
        if not any(curve.corrected_by for curve in curves):
            return np.zeros((len(self.samples), 0))
        pressure = np.concatenate([g.pressure_mbar for g in self.groups])
        return corrected.columns_of(curves, pressure, self.best_mm, self.slope_mm_per_mbar)

    def outlier_probability(self) -> Array:
        """Return each sample's probability (u,) of not belonging to its curve.

        A placement that differs from the others is no outlier, however few its samples are.
        """
        step_mm = steps_of_samples_mm(self.samples)
        linear = self._with_placements()
        return outlier_probability(linear, self.samples, step_mm, self.pressure_error_mm)

    def left_of_curves_mm(
        self, kept: NDArray[np.bool_], learned: tuple[float, float] = (0.0, 0.0)
    ) -> list[Array]:
        """Return what is left of each curve, by its samples (u,) that are kept.

        Of curves together that is without what their placements probably did, and the unknowns
        with them: each curve by its own spread, so that one that is off sways little. `learned` are
        the scatter and the zero, mm, of placements if they are more than is expected.
        """
        samples, linear = self.samples.only(kept), self._with_placements(learned)
        ends = np.cumsum(np.bincount(samples.curve, minlength=self.samples.curves))[:-1]
        residual, slopes = linear.residual_mm[kept], linear.slopes_mm[kept]
        parts = np.split(residual, ends)
        if len(parts) > 1:
            spread = [max(float(np.sqrt(np.mean(r**2))), NOISE.least_mm) for r in parts]
            weight = 1.0 / np.repeat(spread, [len(r) for r in parts]) ** 2
            whole = (slopes.T * weight) @ slopes + linear.precision
            residual = residual - slopes @ np.linalg.solve(whole, slopes.T @ (weight * residual))
            parts = np.split(residual, ends)
        return parts

    def slipped(
        self, left_mm: Sequence[Array], kept: NDArray[np.bool_], noise_mm: float
    ) -> list[bool]:
        """Return of each curve whether what is left of it has a step that is not its readings'.

        Where a curve is steep the pressure's noise is the larger: that is no step either.
        """
        steep = np.sqrt(1.0 + np.square(self.pressure_error_mm / max(noise_mm, NOISE.least_mm)))
        each = [steep[kept & (self.samples.curve == i)] for i in range(self.samples.curves)]
        steps_mm = 1e-3 * np.array(steps_of_curves_um(self.samples))
        return [
            jumps(left / scale, float(step))
            for left, scale, step in zip(left_mm, each, steps_mm, strict=True)
        ]

    def misfits(self, kept: NDArray[np.bool_], covariance: Covariance) -> list[SquaredMisfit]:
        """Return χ² of each group by the covariance of the samples (u,) that are kept."""
        condition = self.samples.condition[kept]
        return [
            model.misfit(g.deflection_mm, OnKept(here, _of_group(covariance, condition == number)))
            for number, (g, model, here) in enumerate(
                zip(self.groups, self.models, split_by_group(self.groups, kept), strict=True)
            )
        ]

    def _with_placements(self, learned: tuple[float, float] = (0.0, 0.0)) -> LinearModel:
        """Return the linear model with what placements of curves together are expected to do."""
        linear, samples = self.linear, self.samples
        scatter, zero_mm = expected_sizes(self.sensor.placement_scatter)
        if samples.curves < 2 or not zero_mm:
            return linear
        scatter, zero_mm = max(scatter, learned[0]), max(zero_mm, learned[1])
        one = (samples.placement[:, None] == np.unique(samples.placement)).astype(float)
        softer = (samples.pressure_mbar * self.slope_mm_per_mbar)[:, None] * one
        slopes = np.hstack([linear.slopes_mm, scatter * softer, zero_mm * one])
        precision = np.eye(slopes.shape[1])  # columns as large as their standard deviations
        k = len(linear.precision)
        precision[:k, :k] = linear.precision
        return LinearModel(linear.residual_mm, slopes, precision)

    def pressure_sd_mbar(self) -> Array:
        """Return the pressure readings' standard deviations (u,): stated, or each curve's own."""
        return np.concatenate([_pressure_sd_mbar(g, self.sensor) for g in self.groups])

    def choose_errors(
        self,
        kept: NDArray[np.bool_],
        thickness_error_mm: Array | None = None,
        error_models: Sequence[ErrorModel] | None = None,
    ) -> ErrorChoice:
        """Return what errors the samples have that are kept.

        `thickness_error_mm` (u,) is what a placement's own thickness does; `error_models` are those
        to choose from, all that there are if it is None.
        """
        samples = self.samples.only(kept)
        residual = self.linear.residual_mm[kept]
        pressure_error_mm = self.pressure_error_mm[kept]
        relative = _relative_noise(residual, samples, pressure_error_mm)
        samples = replace(samples, relative_noise=relative)
        linear = LinearModel(residual, self.linear.slopes_mm[kept], self.linear.precision)
        look = Look(
            samples,
            self.best_mm[kept],
            self.slope_mm_per_mbar[kept],
            residual,
            linear.slopes_mm,
            self.sensor.noise_um,
            self.pressure_sd_mbar()[kept],
            pressure_error_mm,
            self.sensor.placement_scatter,
            thickness_error_mm=None if thickness_error_mm is None else thickness_error_mm[kept],
        )
        rest = (MESH_REST * self.best_mm[kept]) ** 2
        columns = np.hstack([self.mesh_columns(), self.probe_columns()])[kept]
        return choose_errors(look, linear, columns, rest, error_models)


def _pressure_sd_mbar(g: Group, sensor: Sensor) -> Array:
    stated = sensor.pressure_noise_mbar
    found = []
    for member in g.members:
        curve, mask = member.curve, member.mask
        sd = stated
        if sd is None:
            sd = pressure_noise_mbar(curve.time_s[mask], curve.pressure_mbar[mask])
        found.append(np.full(member.count, sd))
    return np.concatenate(found)


def _on_smooth_pressures(
    groups: Sequence[Group],
    models: Sequence[CurveModel],
    best: Array,
    database: Database,
    kappa: KappaConvention,
    sensor: Sensor,
) -> tuple[Sequence[Group], Sequence[CurveModel]]:
    """Return groups and models at smooth pressures, where the readings are noisy.

    Each sample goes along the best fit's curve (p,), so that what the noise did to it remains.
    """
    found = []
    for g, model in zip(groups, models, strict=True):
        sd = _pressure_sd_mbar(g, sensor)
        if not sd.any():
            found.append((g, model))
            continue
        smooth = g.smoothed(sd)
        there = smooth.model(database, kappa)
        along = (there.deflection_mm(best[None]) - model.deflection_mm(best[None]))[0]
        found.append((smooth.moved(along), there))
    return [g for g, _ in found], [model for _, model in found]


def _relative_noise(residual: Array, samples: Samples, pressure_error_mm: Array) -> Array:
    """Return each curve's noise (u,) relative to that of all, 1 where they are alike.

    Without what rounding and the pressures' noise add; below these it is not told, and taken for
    that of the others.
    """
    ends = samples.ends
    parts = np.split(residual, ends[:-1])
    if len(parts) == 1:
        return np.ones(len(residual))
    counts = np.diff([0, *ends])
    rough = np.array([max(r, NOISE.least_mm) for r in map(roughness, parts)])
    added = (1e-3 * np.array(steps_of_curves_um(samples))) ** 2 / 12.0
    each = np.split(pressure_error_mm, ends[:-1])
    added += np.array([float(np.mean(e**2)) if len(e) else 0.0 for e in each])
    before = np.square(rough) - added
    own = np.where(added == 0.0, rough, np.sqrt(np.where(before > added, before, np.nan)))
    if not np.isfinite(own).any():
        return np.ones(len(residual))
    own = np.where(np.isfinite(own), own, np.nanmedian(own))
    usual = float(np.median(own))
    chance = 1.5 / np.sqrt(2.0 * np.maximum(counts, 1)) * np.fmax(rough / own, 1.0) ** 2
    apart = np.abs(np.log(own / usual)) > POSTERIOR.alike * chance
    return np.repeat(np.where(apart, own / usual, 1.0), counts)


def about(
    groups: Sequence[Group],
    models: Sequence[CurveModel],
    space: ParameterSpace,
    unit: Array,
    sensor: Sensor,
    priors: Sequence[GaussianPrior] = (),
    elsewhere: Elsewhere | None = None,
) -> Fitted:
    """Return the curves with the fit at a point (k,) of the unit cube, linearised.

    `elsewhere` says how the model goes on beside pressures that were held.
    """
    k = len(unit)
    steps = _SLOPE_STEP * np.eye(k)
    up, down = np.clip(unit + steps, 0.0, 1.0), np.clip(unit - steps, 0.0, 1.0)
    points = space.from_unit(np.vstack([unit, up, down]))
    curves = np.hstack([model.deflection_mm(points) for model in models])
    here = curves[0]
    # Next to where the model ends a difference is one-sided.
    has_above, has_below = np.isfinite(curves[1 : k + 1]), np.isfinite(curves[k + 1 :])
    above = np.where(has_above, curves[1 : k + 1], here)
    below = np.where(has_below, curves[k + 1 :], here)
    far_above, far_below = np.diag(up) - unit, unit - np.diag(down)
    reach = has_above * far_above[:, None] + has_below * far_below[:, None]
    slopes = (above - below) / np.maximum(reach, 1e-12)
    precision = FLAT_PRECISION * np.eye(k)
    for prior in priors:
        moved = (prior.differences(points[1 : k + 1]) - prior.differences(points[k + 1 :]))[:, 0]
        slope = moved / (np.diag(up) - np.diag(down))
        precision += np.outer(slope, slope)
    samples = samples_of(groups)
    residual = np.concatenate([g.deflection_mm for g in groups]) - here
    columns = _within(unit, residual, slopes.T)
    linear = LinearModel(residual, columns, precision)
    return Fitted(groups, models, space, samples, points[0], here, linear, sensor, elsewhere)


def _within(unit: Array, residual: Array, slopes: Array) -> Array:
    """Return the slopes (u, k), zero of unknowns at a bound that would have to go far beyond it.

    The linear model knows no bounds: what only an unknown outside of its range explains is error.
    """
    stuck = (unit <= 0.0) | (unit >= 1.0)
    if not stuck.any():
        return slopes
    kept = np.where(stuck, 0.0, slopes)
    with_all, without = (
        float(np.square(residual - c @ np.linalg.lstsq(c, residual)[0]).sum())
        for c in (slopes, kept)
    )
    return kept if without > POSTERIOR.beyond * with_all else slopes


def split_by_group(groups: Sequence[Group], values: NDArray[Any]) -> list[NDArray[Any]]:
    """Return values (u, …) by group."""
    return np.split(values, np.cumsum([len(g.deflection_mm) for g in groups])[:-1])


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
    kept: NDArray[np.bool_] | None = None,
    priors: Sequence[GaussianPrior] = (),
    error_models: Sequence[ErrorModel] | None = None,
    sought: bool = False,
) -> Uncertainty:
    """Return the posterior about the minima (m, k), points of the space's unit cube, best first.

    `models` are those of the groups at their stated thicknesses; `kept` (u,) are the samples that
    belong to the curves; `error_models` are those to choose from, all that there are if None.
    """
    names = space.names
    given, own_priors, priors = (groups, models, space), priors, list(priors)
    modes = minima[: POSTERIOR.modes]
    best = space.from_unit(minima[0])
    relative_sd = stated_sd = max(g.thickness_sd_mm / g.geometry.thickness_mm for g in groups)
    own_thickness = sensor.placement_scatter != 0.0 and samples_of(groups).placements > 1
    if own_thickness:
        # As much of the variance is the site's, and is common, as is each placement's.
        relative_sd *= POSTERIOR.common_thickness**0.5
    groups, models = _on_smooth_pressures(groups, models, best, database, kappa, sensor)
    if relative_sd > 0.0:
        models = [g.model(database, kappa, relative_sd) for g in groups]
        space = _with_thickness_ratio(space, models)
        priors.append(GaussianPrior(len(best), 1.0, relative_sd))
        stated = space.to_unit(np.append(best, 1.0))[-1]
        modes = np.column_stack([modes, np.full(len(modes), stated)])
    fitted = about(groups, models, space, modes[0], sensor, priors, Elsewhere(database, kappa))
    if kept is None:
        kept = np.ones(len(fitted.samples), dtype=bool)
    thickness_error_mm = None
    if own_thickness and stated_sd > 0.0:
        own_sd = np.sqrt(1.0 - POSTERIOR.common_thickness) * stated_sd
        thickness_error_mm = own_sd * _thickness_slope_mm(models, best)
    errors = fitted.choose_errors(kept, thickness_error_mm, error_models)
    parts: list[SquaredMisfit] = [*fitted.misfits(kept, errors.mode), *priors]
    if fitted.samples.placements > 1 and not sought:
        # Least squares knew of no placements: by these errors the best may lie in another valley.
        others = _other_valleys(space, JointMisfit(parts), int(kept.sum()), modes, rng.spawn(1)[0])
        if others.better:
            there = others.unit[0, : len(names)]
            return assess(
                database, kappa, *given, np.vstack([there, minima]), sensor, rng, kept=kept,
                priors=own_priors, error_models=error_models, sought=True,
            )  # fmt: skip
        modes = np.vstack([modes, others.unit])
    likelihood = IntegratedLikelihood(
        models, fitted.linear.residual_mm[kept], fitted.parameters, kept, errors
    )

    def log_density(parameters: Array) -> Array:
        return likelihood(parameters) - 0.5 * sum(prior(parameters) for prior in priors)

    draws = sample(space, JointMisfit(parts), modes, rng, log_density=log_density)
    judged = _judged(fitted, kept, errors)
    noise_mbar = float(np.median(fitted.pressure_sd_mbar()))
    return Uncertainty(names, space, draws, judged, tuple(parts), relative_sd, noise_mbar)


def _with_thickness_ratio(space: Space, models: Sequence[CurveModel]) -> Space:
    """Return the space with the thickness over the stated one, as far as all models know it."""
    low = max(float(model.space.bounds[0][-1]) for model in models)
    high = min(float(model.space.bounds[1][-1]) for model in models)
    return space.extended("thickness_ratio", low, high)


def _thickness_slope_mm(models: Sequence[CurveModel], parameters: Array) -> Array:
    """Return what the deflections (u,) change by the thickness' ratio at 1, parameters (p,)."""
    ends = np.append(parameters, 1.0) * np.ones((2, 1))
    ends[:, -1] += [-_SLOPE_STEP, _SLOPE_STEP]
    low_mm, high_mm = np.hstack([model.deflection_mm(ends) for model in models])
    return np.asarray(np.nan_to_num(high_mm - low_mm) / (2.0 * _SLOPE_STEP))


class _Valleys(NamedTuple):
    """Minima (m, k) that are none of those known, best first; whether the first is a better one."""

    unit: Array
    better: bool


def _other_valleys(
    space: ParameterSpace, misfit: JointMisfit, points: int, modes: Array, rng: np.random.Generator
) -> _Valleys:
    """Return what a search of all skins finds beside the valleys of `modes` (m, k)."""
    found = search_everywhere(Problem(space, misfit, points), Options(), rng).minima
    if found is None or not len(found):
        return _Valleys(modes[:0], False)
    known = polish(space, misfit, modes)
    least = float(known.cost.min())
    at = polish(space, misfit, found[: POSTERIOR.modes])
    apart = np.abs(at.unit[:, None] - known.unit).max(axis=2).min(axis=1) > STARTS.alike
    kept = apart & (at.cost < least + POSTERIOR.hopeless)
    order = np.flatnonzero(kept)[np.argsort(at.cost[kept], kind="stable")]
    better = bool(len(order)) and float(at.cost[order[0]]) < least - POSTERIOR.elsewhere
    return _Valleys(at.unit[order], better)


def judge_at(
    database: Database,
    kappa: KappaConvention,
    groups: Sequence[Group],
    models: Sequence[CurveModel],
    space: Space,
    parameters: Array,
    sensor: Sensor,
    priors: Sequence[GaussianPrior] = (),
) -> Judged:
    """Return what `assess` says of the errors, at an answer (p,) of a method without intervals.

    Such a method fits glitches too: for the judgement they are left out, and the answer stays.
    """
    groups, models = _on_smooth_pressures(groups, models, parameters, database, kappa, sensor)
    unit, elsewhere = space.to_unit(parameters), Elsewhere(database, kappa)
    fitted = about(groups, models, space, unit, sensor, priors, elsewhere)
    kept = fitted.outlier_probability() <= 0.5
    return _judged(fitted, kept, fitted.choose_errors(kept))


def _judged(fitted: Fitted, kept: NDArray[np.bool_], errors: ErrorChoice) -> Judged:
    left_mm = fitted.linear.residual_mm[kept]
    residual_um = 1e3 * float(np.sqrt(np.mean(left_mm**2))) if len(left_mm) else 0.0
    return judge_errors(errors, fitted.sensor.noise_um, residual_um)


def _of_group(covariance: Covariance, members: NDArray[np.bool_]) -> Covariance:
    if members.all():
        return covariance
    part = covariance.only(members)
    mine = np.abs(part.columns_mm).max(axis=0, initial=0.0) > 0.0
    ends = tuple(dict.fromkeys(e for e in part.ends if e > 0))
    return replace(part, shapes_mm=part.columns_mm[:, mine], sizes=None, ends=ends)
