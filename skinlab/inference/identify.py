"""Identify a curve: choose its samples, ask the database, run a method, judge the answer."""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.corrected import as_read
from skinlab.curves.curve import Curve
from skinlab.curves.heights import heights_of
from skinlab.curves.probe_file import check_counted_once
from skinlab.errors import BrokenPluginError, InputError, NotTrustworthyError
from skinlab.inference import flags
from skinlab.inference.advice import advise
from skinlab.inference.covariance import OnKept, independent
from skinlab.inference.error_judgement import misses_noise
from skinlab.inference.intervals import (
    at_an_end,
    correlation,
    is_logarithmic,
    most_of_the_range,
    summary,
)
from skinlab.inference.joint import GaussianPrior, JointMisfit
from skinlab.inference.methods import METHODS, auto, get_method
from skinlab.inference.methods.checked import checked_estimate
from skinlab.inference.noise import contradicted_pressure_noise, mesh_error_shapes
from skinlab.inference.optimise import polish
from skinlab.inference.posterior import Draws, sample
from skinlab.inference.problem import Estimate, Options, Problem, SquaredMisfit
from skinlab.inference.result import Advice, Identification, Provenance, Value
from skinlab.inference.samples import (
    Fitted,
    Group,
    choose,
    glitches_of,
    group,
    outliers_by_file,
)
from skinlab.inference.settings import INTERVALS, NOISE, OUTLIERS, STARTS
from skinlab.inference.uncertainty import (
    Elsewhere,
    Sensor,
    Uncertainty,
    about,
    assess,
    judge_at,
    split_by_group,
)
from skinlab.mechanics.materials import get_law
from skinlab.mechanics.materials.compressibility import KappaConvention
from skinlab.mechanics.model_file import BASE, Model, model_of_law
from skinlab.parameters import Space
from skinlab.plugins import blaming
from skinlab.tables.base import CurveModel, Database

Array = NDArray[np.float64]

_QUICK = Options(
    samples=STARTS.growing_samples,
    most_iterations=STARTS.growing_steps,
)


@dataclass(frozen=True)
class Identifier:
    """How to identify curves; the same for all curves of a run.

    `space` is where to search, and with its flat prior what is known beforehand; None: the
    database's whole range (the paper's box for methods that search there). `priors` come on top of
    that. `model` is what all this is from, where it is from a file, else the database's law as it
    is; `clock` only fills the field `seconds`.
    """

    database: Database
    method: str = "auto"
    options: Options = field(default_factory=Options)
    seed: int = 0
    kappa: KappaConvention = "paper"
    phases: tuple[str, ...] = ("load",)
    sensor: Sensor = field(default_factory=Sensor)
    space: Space | None = None
    priors: tuple[GaussianPrior, ...] = ()
    model: Model = BASE
    clock: Callable[[], float] = time.perf_counter

    def __post_init__(self) -> None:
        if self.model is BASE:
            object.__setattr__(self, "model", model_of_law(self.database.law))

    @property
    def model_name(self) -> str | None:
        """How the model is called; None: it is the base law as it is."""
        return None if self.model is BASE else self.model.model.name

    def provenance(self) -> Provenance:
        """Return what a reader of the result must know to repeat it."""
        effects = tuple(sorted(self.model.effects))
        model = f"{self.database.law} kappa={self.kappa} mesh={self.database.mesh_name}"
        if self.model is not BASE:
            model += f" model={self.model.hash}"
        hashed = "sha256:" + hashlib.sha256(model.encode()).hexdigest()
        probe = self.sensor.probe
        return Provenance(
            probe=None if probe is None else (probe.file.serial_number, probe.hash),
            model_name=self.model.model.name,
            model_hash=self.model.hash if effects else hashed,
            effects=effects,
            kappa=self.kappa,
            database_hash=self.database.content_hash,
            method=self.method,
            seed=self.seed,
        )

    def __call__(self, curve: Curve) -> Identification:
        """Return the answer; where there can be none, one whose `error` says why.

        Raises:
            InputError: the method or its options are wrong.
        """
        blank = Identification(
            curve.name,
            curve.setup,
            None,
            points=len(curve),
            phases=self.phases,
            heights=heights_of(curve),
        )
        return self.knowing([curve])._identify([curve], blank)

    def together(self, curves: Sequence[Curve]) -> Identification:
        """Return one answer for one curve or several of one skin; raises as `joint`."""
        return self(curves[0]) if len(curves) == 1 else self.joint(curves)

    def joint(self, curves: Sequence[Curve]) -> Identification:
        """Return one answer for several curves of one skin, each with its own noise.

        Raises:
            InputError: the method or its options are wrong.
        """
        files = tuple(c.name for c in curves)
        blank = Identification(
            ", ".join(files),
            None,
            None,
            points=sum(len(c) for c in curves),
            phases=self.phases,
            files=files,
        )
        return self.knowing(curves)._identify(curves, blank)

    def growing(self, curve: Curve, previous: Identification | None = None) -> Identification:
        """Return a quick answer for a curve that is still being measured, without intervals.

        From where the previous one ended, and a few candidates beside it.

        Raises:
            InputError: the method or its options are wrong.
        """
        start = None
        if previous is not None and previous.parameters is not None:
            start = np.array([v.value for v in previous.parameters.values()])
        quick = replace(self, method="auto", options=_QUICK)
        blank = Identification(curve.name, curve.setup, None, points=len(curve), phases=self.phases)
        return quick._identify([curve], blank, intervals=False, start=start)

    def advise(self, result: Identification, thickness_mm: float) -> list[Advice]:
        """Return what to measure next, given a result with intervals; empty without them."""
        if result.uncertainty is None:
            return []
        return advise(
            result.uncertainty,
            self.database,
            self.kappa,
            thickness_mm,
            placement_scatter=self.sensor.placement_scatter,
            rng=np.random.default_rng(self.seed),
        )

    def corrected(self, curves: Sequence[Curve]) -> list[Curve]:
        """Return the curves without the errors of their probes, as far as calibrations know them.

        Raises:
            InputError: one is of another opening than its probe, or the model knows such an error
                too.
        """
        true = [self.sensor.corrected(curve) for curve in curves]
        for curve in true:
            check_counted_once(curve.corrected_by, self.model.effects)
        return true

    def of_probe(self, curves: Sequence[Curve]) -> Identifier:
        """Return the identifier with the probe file that all these curves came with, if they did.

        It would be used anyway; so the result can say which.
        """
        probes = {None if c.probe is None else c.probe.hash: c.probe for c in curves}
        if self.sensor.probe is not None or len(probes) != 1:
            return self
        return replace(self, sensor=replace(self.sensor, probe=next(iter(probes.values()))))

    def knowing(self, curves: Sequence[Curve]) -> Identifier:
        """Return the identifier with the noise that all these curves' files state alike.

        The identifier's own statement comes first.
        """
        known = {}
        for name in ("noise_um", "pressure_noise_mbar"):
            stated = {getattr(curve, name) for curve in curves}
            if getattr(self.sensor, name) is None and len(stated) == 1:
                known[name] = stated.pop()
        return replace(self, sensor=replace(self.sensor, **known)) if known else self

    def by_their_own(self) -> Identifier:
        """Return the identifier without statements of noise and probe, for curves that have theirs.

        One that is from a session states that one's: another session has its own.
        """
        return replace(self, sensor=Sensor(placement_scatter=self.sensor.placement_scatter))

    def _identify(
        self,
        curves: Sequence[Curve],
        blank: Identification,
        *,
        intervals: bool = True,
        start: Array | None = None,
    ) -> Identification:
        started = self.clock()
        try:
            with blaming():
                answer = self._fitted(curves, blank, intervals=intervals, start=start)
        except BrokenPluginError as error:  # the next curve may do without it
            return replace(blank, error=str(error), seconds=self.clock() - started)
        return replace(answer, seconds=self.clock() - started)

    def _fitted(
        self,
        curves: Sequence[Curve],
        blank: Identification,
        *,
        intervals: bool = True,
        start: Array | None = None,
    ) -> Identification:
        method = get_method(self.method)
        try:
            true = self.corrected(curves)
            groups = group(
                [choose(c, self.phases, self.database, method.most_fitted) for c in true]
            )
            models = [g.model(self.database, self.kappa) for g in groups]
        except (InputError, NotTrustworthyError) as error:
            outside = isinstance(error, NotTrustworthyError)
            why = ("outside_database",) if outside else ()
            return replace(blank, error=str(error), flags=why)
        problem = self._problem(groups, models)
        rng = np.random.default_rng(self.seed)
        if start is not None:
            estimate = auto.identify(problem, self.options, rng, start=start)
        else:
            with METHODS.at_work(method.name):
                estimate = method(problem, self.options, rng)
                if METHODS.origin(method.name) is not None:
                    estimate = checked_estimate(estimate, problem.space)
        kept = np.ones(problem.points, dtype=bool)
        judged = intervals and estimate.minima is not None and len(estimate.minima) > 0
        if judged:
            estimate, kept = self._without_outliers(groups, models, problem, estimate)
            assert estimate.minima is not None
            left = assess(
                self.database,
                self.kappa,
                groups,
                models,
                self.space_of(models[0]),
                estimate.minima,
                self.sensor,
                rng,
                kept=kept,
                priors=self.priors,
            )
            if len(curves) > 1:
                estimate = _likeliest(groups, models, estimate, left, kept)
            answer = self._answer(groups, models, problem, estimate, blank, kept)
            known = _with_uncertainty(
                answer, self.space_of(models[0]), left, self.database.law, self.kappa, self.seed
            )
            missed = self._missed(known, groups, models, problem, estimate, kept)
            return _with_misfit(known, missed) if missed else known
        answer = self._answer(groups, models, problem, estimate, blank, kept)
        if intervals:
            loose = self._not_identifiable(answer, groups, models, estimate)
            answer = self._judged(groups, models, estimate, answer)
            answer = replace(answer, flags=(*answer.flags, *loose))
        return answer

    def _judged(
        self,
        groups: Sequence[Group],
        models: Sequence[CurveModel],
        estimate: Estimate,
        answer: Identification,
    ) -> Identification:
        """Return the answer of a method without intervals with what its errors say of it.

        Next to a noise that was stated by the judgement that all methods share. What the method
        missed is no noise, and contradicts no statement.
        """
        residuals = _residuals(groups, models, estimate)
        if misses_noise(residuals):
            return replace(answer, flags=(*answer.flags, "misfit_above_noise"))
        if self.sensor.noise_um is not None and np.isfinite(np.concatenate(residuals)).all():
            judged = judge_at(
                self.database, self.kappa, groups, models, self.space_of(models[0]),
                estimate.parameters, self.sensor, self.priors,
            )  # fmt: skip
            answer = replace(answer, noise_um=judged.noise_um, error_model=judged.summary)
            answer = replace(answer, flags=(*answer.flags, *judged.flags))
        return answer

    def _missed(
        self,
        answer: Identification,
        groups: Sequence[Group],
        models: Sequence[CurveModel],
        problem: Problem,
        estimate: Estimate,
        kept: NDArray[np.bool_],
    ) -> list[str]:
        """Return the files of curves that the fit misses by more than the answer's errors say.

        Of one curve: by a step, where it is a misfit anyway, or creases. Of several: by a step, or
        by more than lasts; their errors are of all of them, and one that slipped hides among them.
        """
        is_alone = answer.files is None
        if is_alone and not {"crease", "misfit_above_noise"} & set(answer.flags):
            return []
        unit = problem.space.to_unit(estimate.parameters)
        elsewhere = Elsewhere(self.database, self.kappa)
        fit = about(groups, models, problem.space, unit, self.sensor, self.priors, elsewhere)
        members = [member for g in groups for member in g.members]
        names = [member.curve.name for member in members]
        found = answer.placement
        sizes = (found.scatter["value"], 1e-3 * found.offset_um["value"]) if found else (0.0, 0.0)
        each = fit.left_of_curves_mm(kept, sizes)
        slipped = fit.slipped(each, kept, 1e-3 * (answer.noise_um or 0.0))
        return [
            name
            for name, left, slips in zip(names, each, slipped, strict=True)
            if (not is_alone and misses_noise([left])) or slips
        ]

    def _not_identifiable(
        self,
        answer: Identification,
        groups: Sequence[Group],
        models: Sequence[CurveModel],
        estimate: Estimate,
    ) -> list[str]:
        """Return flags of what the samples leave open, for methods without intervals.

        As of those with intervals, by draws about the answer in the database's whole range: the
        curvature there says too little of a curved valley, and a method's own box is no knowledge.
        White noise is as large as the residuals; mesh and database err as they do.
        """
        space = models[0].space if self.space is None else self.space
        residual = np.concatenate(_residuals(groups, models, estimate))
        variance = float(residual @ residual) / max(len(residual) - len(space), 1)
        sigma = max(math.sqrt(variance), NOISE.least_mm)
        everything = [f"not_identifiable:{name}" for name in space.names]
        if not np.isfinite(sigma):
            return everything
        parts: list[SquaredMisfit] = []
        for g, m in zip(groups, models, strict=True):
            w = m.deflection_mm(estimate.parameters[None])[0]
            wrong = mesh_error_shapes(g.pressure_mbar, w), m.error_shapes_mm(estimate.parameters)
            errors = independent(np.full(len(w), sigma), np.hstack(wrong))
            parts.append(m.misfit(g.deflection_mm, errors))
        unit = space.to_unit(estimate.parameters)
        rng = np.random.default_rng(self.seed)
        try:
            draws = sample(space, JointMisfit([*parts, *self.priors]), unit[None], rng)
        except ValueError:  # there is no model about it
            return everything
        known = from_draws(answer, space, draws, self.database.law, self.kappa, self.seed)
        return [flag for flag in known.flags if flag in everything]

    def space_of(self, model: CurveModel) -> Space:
        """Return where is searched with this model of a curve."""
        if self.space is not None:
            return self.space
        return search_space(self.method, self.database.law, model.space)

    def _problem(self, groups: Sequence[Group], models: Sequence[CurveModel]) -> Problem:
        misfits = [m.misfit(g.deflection_mm) for g, m in zip(groups, models, strict=True)]
        space = self.space_of(models[0])
        points = sum(len(g.deflection_mm) for g in groups)
        if len(misfits) == 1:
            return Problem(space, misfits[0], points)
        return Problem(space, JointMisfit(misfits), points)

    def _weighted(
        self,
        groups: Sequence[Group],
        models: Sequence[CurveModel],
        problem: Problem,
        estimate: Estimate,
        kept: NDArray[np.bool_],
    ) -> Estimate:
        """Return the optimum of the samples that are kept.

        Of several curves each is weighted by its own noise; priors count.
        """
        assert estimate.minima is not None
        misfits: list[SquaredMisfit] = []
        begin = 0
        for g, m in zip(groups, models, strict=True):
            off = m.deflection_mm(estimate.parameters[None])[0] - g.deflection_mm
            here = kept[begin : begin + len(off)]
            begin += len(off)
            sigma = [
                np.full(int(k.sum()), self._spread_mm(r[k]))
                for r, k in zip(g.split(off), g.split(here), strict=True)
            ]
            misfits.append(
                m.misfit(g.deflection_mm, OnKept(here, independent(np.concatenate(sigma))))
            )
        total = JointMisfit([*misfits, *self.priors])
        found = polish(problem.space, total, estimate.minima, least_gain=1e-9)
        best = np.argsort(found.cost, kind="stable")
        parameters = problem.space.from_unit(found.unit[best[0]])
        return replace(
            estimate,
            parameters=parameters,
            error_um=_error_um(groups, models, parameters, kept),
            iterations=estimate.iterations + found.iterations,
            evaluations=estimate.evaluations + found.evaluations,
            minima=found.unit[best[np.isfinite(found.cost[best])]],
        )

    def _spread_mm(self, residual_mm: Array) -> float:
        if self.sensor.noise_um is not None:
            return 1e-3 * self.sensor.noise_um
        return max(float(np.sqrt(np.mean(residual_mm**2))), NOISE.least_mm)

    def _without_outliers(
        self,
        groups: Sequence[Group],
        models: Sequence[CurveModel],
        problem: Problem,
        estimate: Estimate,
    ) -> tuple[Estimate, NDArray[np.bool_]]:
        """Return the optimum without samples that do not belong, and which (u,) do."""
        kept = np.ones(problem.points, dtype=bool)
        elsewhere = Elsewhere(self.database, self.kappa)
        weighted = len(groups) > 1 or len(groups[0].members) > 1 or bool(self.priors)
        for _ in range(OUTLIERS.fits):
            if weighted:
                estimate = self._weighted(groups, models, problem, estimate, kept)
            assert estimate.minima is not None
            best = estimate.minima[0]
            fit = about(groups, models, problem.space, best, self.sensor, self.priors, elsewhere)
            belong = fit.outlier_probability() <= 0.5
            if (belong == kept).all():
                break
            kept, weighted = belong, True
        else:  # a sample at the border went out and came back: the optimum of those that are kept
            estimate = self._weighted(groups, models, problem, estimate, kept)
        return estimate, kept

    def _answer(
        self,
        groups: Sequence[Group],
        models: Sequence[CurveModel],
        problem: Problem,
        estimate: Estimate,
        blank: Identification,
        kept: NDArray[np.bool_],
    ) -> Identification:
        x = estimate.parameters
        members = [member for g in groups for member in g.members]
        fitted, model_mm, outliers = None, None, None
        by_file: dict[str, list[int]] = {}
        if len(members) > 1:
            ends = np.cumsum([m.count for m in members])[:-1]
            by_file = outliers_by_file(members, np.split(kept, ends))
        else:
            mask = members[0].mask
            model_mm = np.full(len(mask), np.nan)
            at_best = models[0].deflection_mm(x[None])[0]
            _, model_mm[mask] = as_read(members[0].curve, groups[0].pressure_mbar, at_best)
            fitted, outliers = mask.copy(), np.zeros(len(mask), dtype=bool)
            fitted[mask], outliers[mask] = kept, ~kept
            if members[0].glitches is not None:
                outliers |= members[0].glitches
        points = int(kept.sum())
        left_out = int((~kept).sum()) + glitches_of(members)
        values = {n: Value(float(v)) for n, v in zip(problem.space.names, x, strict=True)}
        return replace(
            blank,
            parameters=values,
            optimum={name: value.value for name, value in values.items()},
            derived=derived_of(self.database.law, problem.space.names, x, self.kappa),
            own_bounds=tuple(self.model.parameters) if self.space is not None else (),
            error_um=estimate.error_um,
            rms_um=estimate.error_um * float(np.sqrt(points)),
            iterations=estimate.iterations,
            evaluations=estimate.evaluations,
            flags=(
                *self._flags(members, self.space_of(models[0]), estimate),
                *(["crease"] if any(m.creases(x[None])[0] for m in models) else []),
                *([f"outliers:{left_out}"] if left_out else []),
            ),
            fitted=fitted,
            fitted_points=points,
            model_mm=model_mm,
            outliers=outliers,
            outliers_by_file=by_file,
        )

    def _flags(self, members: Sequence[Fitted], space: Space, estimate: Estimate) -> list[str]:
        curves = [m.curve for m in members]
        unit = space.to_unit(estimate.parameters)
        return [
            *flags.of_optimum(space.names, unit, converged=estimate.converged),
            *flags.of_curves(curves, [m.beyond for m in members]),
            *self._pressure_flags(members),
            *(f"thinned:{m.every}" for m in members if m.every > 1),
        ]

    def _pressure_flags(self, members: Sequence[Fitted]) -> list[str]:
        """Return the flag of a stated pressure noise that most of the curves contradict."""
        stated = self.sensor.pressure_noise_mbar
        if stated is None:
            return []
        each = [(m.curve.time_s[m.mask], m.curve.pressure_mbar[m.mask]) for m in members]
        found = [contradicted_pressure_noise(t, p, stated) for t, p in each]
        against = [mbar for mbar in found if mbar is not None]
        if 2 * len(against) <= len(found):
            return []
        return [f"stated_pressure_noise_contradicted:{float(np.median(against)):.2g}"]


def _error_um(
    groups: Sequence[Group],
    models: Sequence[CurveModel],
    parameters: Array,
    kept: NDArray[np.bool_],
) -> float:
    """Return the paper's E of parameters (p,), of the samples (u,) that are kept."""
    left = [
        m.misfit(g.deflection_mm, OnKept(k, independent(np.ones(int(k.sum())))))
        for g, m, k in zip(groups, models, split_by_group(groups, kept), strict=True)
    ]
    squares = float(JointMisfit(left)(parameters[None])[0])
    return 1e3 * math.sqrt(squares) / int(kept.sum())


def _likeliest(
    groups: Sequence[Group],
    models: Sequence[CurveModel],
    estimate: Estimate,
    left: Uncertainty,
    kept: NDArray[np.bool_],
) -> Estimate:
    """Return the best fit of curves together, by the errors that were learned.

    Least squares know of no placements, and may end far off what is likely, at a bound.
    """
    best = left.draws.parameters[np.argmax(left.draws.log_target), : len(left.names)]
    return replace(estimate, parameters=best, error_um=_error_um(groups, models, best, kept))


def _residuals(
    groups: Sequence[Group], models: Sequence[CurveModel], estimate: Estimate
) -> list[Array]:
    """Return the residuals (u,), mm, of each curve."""
    found = []
    for g, m in zip(groups, models, strict=True):
        found += g.split(g.deflection_mm - m.deflection_mm(estimate.parameters[None])[0])
    return found


def _with_misfit(answer: Identification, files: Sequence[str]) -> Identification:
    """Return the answer as a misfit: of curves together that of some files."""
    if answer.files is None:  # what fits a slip may crease; the skin need not
        others = [f for f in answer.flags if f not in ("crease", "misfit_above_noise")]
        return replace(answer, flags=(*others, "misfit_above_noise"))
    flags = dict.fromkeys((*answer.flags, "misfit_above_noise"))
    by_file = {name: ["misfit_above_noise"] for name in files}
    return replace(answer, flags=tuple(flags), flags_by_file=by_file)


def search_space(method: str, law: str, whole: Space) -> Space:
    """Return where a method searches: the paper's ones in the law's published box, if any."""
    published = get_law(law).published_space if get_method(method).in_papers_box else None
    return whole if published is None else published


def derived_of(
    law: str, names: Sequence[str], values: Array, kappa: KappaConvention
) -> dict[str, float | None]:
    """Return what a law's reports show besides its parameters (p,), the first of `names`."""
    one = get_law(law)
    at = {n: float(v) for n, v in zip(names, values, strict=True) if n in one.names}
    return dict(one.derived(at, kappa))


def _with_uncertainty(
    answer: Identification,
    space: Space,
    left: Uncertainty,
    law: str,
    kappa: KappaConvention,
    seed: int,
) -> Identification:
    found = left.errors
    known = from_draws(answer, space, left.draws, law, kappa, seed)
    beyond = ["outside_database"] if left.thickness_is_cut else []
    return replace(
        known,
        noise_um=found.noise_um,
        error_model=found.summary,
        placement=found.placement,
        evaluations=answer.evaluations + left.draws.evaluations,
        flags=tuple(dict.fromkeys([*beyond, *known.flags, *found.flags])),
        uncertainty=left,
    )


def from_draws(
    answer: Identification,
    space: Space,
    draws: Draws,
    law: str,
    kappa: KappaConvention,
    seed: int,
) -> Identification:
    """Return the answer with values and intervals of draws, and flags of what these leave open.

    `space` is what the draws are flat in; its first parameters are the answer's.
    """
    names = tuple(answer.parameters or ())
    rng = np.random.default_rng(seed)
    priors = space.from_unit(rng.random((INTERVALS.prior_draws, len(space))))
    values, loose = {}, []
    at_end = at_an_end(draws.unit[:, : len(space)])
    for i, name in enumerate(names):
        prior = priors[:, i]
        bounds = (float(space.bounds[0][i]), float(space.bounds[1][i]))
        value, low, high = summary(
            draws.parameters[:, i],
            draws.weight,
            draws.log_target,
            bounds,
            logarithmic=is_logarithmic(prior),
            at_end=at_end,
        )
        values[name] = Value(value, low, high)
        if most_of_the_range((low, high), prior):
            loose.append(f"not_identifiable:{name}")
    shown = np.array([value.value for value in values.values()])
    return replace(
        answer,
        parameters=values,
        derived=derived_of(law, names, shown, kappa),
        correlation=correlation(draws.parameters[:, : len(names)], draws.weight),
        flags=(*answer.flags, *loose),
    )
