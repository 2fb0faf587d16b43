"""Identify a curve: choose its samples, ask the database, run a method, judge the answer."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import Curve
from skinlab.errors import InputError, NotTrustworthyError
from skinlab.inference.advice import advise
from skinlab.inference.intervals import correlation, interval, is_logarithmic, most_of_the_range
from skinlab.inference.joint import GaussianPrior, JointMisfit
from skinlab.inference.methods import auto, get_method
from skinlab.inference.noise import Whitening
from skinlab.inference.optimise import polish
from skinlab.inference.problem import Estimate, Options, Problem
from skinlab.inference.result import Advice, Identification, Provenance, Value
from skinlab.inference.samples import Fitted, Group, choose, group
from skinlab.inference.uncertainty import Sensor, Uncertainty, assess, noise_of_curves
from skinlab.mechanics.materials.compressibility import KappaConvention, kappa_ratio, nu_consistent
from skinlab.mechanics.model_file import BASE, Model
from skinlab.parameters import PAPER_BOX, ParameterSpace
from skinlab.tables.base import CurveModel, Database

Array = NDArray[np.float64]

_AT_BOUND = 1e-5  # of the parameter's range
_PRIOR_DRAWS = 1000
_QUICK = Options(samples=200, best=20, most_iterations=30)  # for a curve that still grows


@dataclass(frozen=True)
class Identifier:
    """How to identify curves; the same for all curves of a run.

    `space` is where to search, and with its flat prior what is known beforehand; None: the
    database's whole range (the paper's box for methods that search there). `priors` come on top of
    that. `model` is what all this is from, where it is from a file; `clock` only fills the field
    `seconds`.
    """

    database: Database
    method: str = "auto"
    options: Options = field(default_factory=Options)
    seed: int = 0
    kappa: KappaConvention = "paper"
    phases: tuple[str, ...] = ("load",)
    sensor: Sensor = field(default_factory=Sensor)
    space: ParameterSpace | None = None
    priors: tuple[GaussianPrior, ...] = ()
    model: Model = BASE
    clock: Callable[[], float] = time.perf_counter

    def provenance(self) -> Provenance:
        """Return what a reader of the result must know to repeat it."""
        effects = tuple(sorted(self.model.effects))
        model = f"{self.database.law} kappa={self.kappa} mesh={self.database.mesh_name}"
        if self.model is not BASE:
            model += f" model={self.model.hash}"
        hashed = "sha256:" + hashlib.sha256(model.encode()).hexdigest()
        return Provenance(
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
        blank = Identification(curve.name, curve.setup, None, points=len(curve), phases=self.phases)
        return self._identify([curve], blank)

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
        return self._identify(curves, blank)

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
            pressure_noise_mbar=self.sensor.pressure_noise_mbar or 0.0,
            rng=np.random.default_rng(self.seed),
        )

    def _identify(
        self,
        curves: Sequence[Curve],
        blank: Identification,
        *,
        intervals: bool = True,
        start: Array | None = None,
    ) -> Identification:
        method = get_method(self.method)
        started = self.clock()
        try:
            groups = group([choose(c, self.phases, self.database) for c in curves])
            models = [g.model(self.database, self.kappa) for g in groups]
        except (InputError, NotTrustworthyError) as error:
            outside = isinstance(error, NotTrustworthyError)
            flags = ("outside_database",) if outside else ()
            return replace(blank, error=str(error), flags=flags)
        problem = self._problem(groups, models)
        rng = np.random.default_rng(self.seed)
        if start is None:
            estimate = method(problem, self.options, rng)
        else:
            estimate = auto.identify(problem, self.options, rng, start=start)
        if (len(curves) > 1 or self.priors) and estimate.minima is not None:
            estimate = self._weighted(groups, models, problem, estimate)
        answer = self._answer(groups, models, problem, estimate, blank)
        if intervals and estimate.minima is not None and len(estimate.minima):
            left = assess(
                self.database,
                self.kappa,
                groups,
                models,
                problem.space,
                estimate.minima,
                self.sensor,
                rng,
                priors=self.priors,
            )
            answer = _with_uncertainty(answer, problem.space, left, self.seed)
        return replace(answer, seconds=self.clock() - started)

    def _problem(self, groups: Sequence[Group], models: Sequence[CurveModel]) -> Problem:
        misfits = [m.misfit(g.deflection_mm) for g, m in zip(groups, models, strict=True)]
        space = self.space
        if space is None:
            space = PAPER_BOX if get_method(self.method).in_papers_box else models[0].space
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
    ) -> Estimate:
        """Return the optimum with every curve weighted by its own noise, and with the priors."""
        assert estimate.minima is not None
        misfits = []
        for g, m in zip(groups, models, strict=True):
            at_best = m.deflection_mm(estimate.parameters[None])[0]
            sigma = np.concatenate(
                [
                    np.full(member.count, 1e-3 * noise.assumed_um)
                    for member, noise in zip(
                        g.members,
                        noise_of_curves(g, at_best, problem.points, self.sensor),
                        strict=True,
                    )
                ]
            )
            misfits.append(m.misfit(g.deflection_mm, Whitening(sigma, np.zeros((len(sigma), 0)))))
        total = JointMisfit([*misfits, *self.priors])
        found = polish(problem.space, total, estimate.minima, least_gain=1e-9)
        best = np.argsort(found.cost, kind="stable")
        parameters = problem.space.from_unit(found.unit[best[0]])
        return replace(
            estimate,
            parameters=parameters,
            error_um=float(problem.error_um(parameters[None])[0]),
            iterations=estimate.iterations + found.iterations,
            evaluations=estimate.evaluations + found.evaluations,
            minima=found.unit[best[np.isfinite(found.cost[best])]],
        )

    def _answer(
        self,
        groups: Sequence[Group],
        models: Sequence[CurveModel],
        problem: Problem,
        estimate: Estimate,
        blank: Identification,
    ) -> Identification:
        x = estimate.parameters
        members = [member for g in groups for member in g.members]
        ratio = float(kappa_ratio(x[2], self.kappa))
        fitted, model_mm = None, None
        if len(members) == 1:
            fitted = members[0].mask
            model_mm = np.full(len(fitted), np.nan)
            model_mm[fitted] = models[0].deflection_mm(x[None])[0]
        return replace(
            blank,
            parameters={n: Value(float(v)) for n, v in zip(problem.space.names, x, strict=True)},
            nu_consistent=float(nu_consistent(ratio)),
            kappa_MPa=ratio * float(x[0]),
            error_um=estimate.error_um,
            rms_um=estimate.error_um * float(np.sqrt(problem.points)),
            iterations=estimate.iterations,
            evaluations=estimate.evaluations,
            flags=self._flags(members, problem.space, estimate),
            fitted=fitted,
            fitted_points=problem.points,
            model_mm=model_mm,
        )

    def _flags(
        self, members: Sequence[Fitted], space: ParameterSpace, estimate: Estimate
    ) -> tuple[str, ...]:
        unit = space.to_unit(estimate.parameters)
        flags = [
            f"at_bound:{name}"
            for name, at in zip(space.names, unit, strict=True)
            if min(at, 1 - at) <= _AT_BOUND
        ]
        curves = [m.curve for m in members]
        if any(
            c.in_phases(self.phases).sum() > m.count for c, m in zip(curves, members, strict=True)
        ):
            flags.append("outside_database")
        if not estimate.converged:
            flags.append("not_converged")
        if any(c.setup.cycle != 1 for c in curves):
            flags.append("not_first_cycle")
        if any(c.partial for c in curves):
            flags.append("partial_curve")
        return tuple(flags)


def _with_uncertainty(
    answer: Identification, space: ParameterSpace, left: Uncertainty, seed: int
) -> Identification:
    draws, names = left.draws, space.names
    priors = space.from_unit(np.random.default_rng(seed).random((_PRIOR_DRAWS, len(names))))
    values, flags = {}, []
    for i, name in enumerate(names):
        prior = priors[:, i]
        best = (answer.parameters or {})[name].value
        bounds = (float(space.bounds[0][i]), float(space.bounds[1][i]))
        low, high = interval(
            draws.parameters[:, i],
            draws.weight,
            best,
            bounds,
            logarithmic=is_logarithmic(prior),
        )
        values[name] = Value(best, low, high)
        if most_of_the_range((low, high), prior):
            flags.append(f"not_identifiable:{name}")
    if left.above_noise:
        flags.append("misfit_above_noise")
    return replace(
        answer,
        parameters=values,
        correlation=correlation(draws.parameters[:, : len(names)], draws.weight),
        noise_um=left.noise_um,
        evaluations=answer.evaluations + draws.evaluations,
        flags=(*answer.flags, *flags),
        uncertainty=left,
    )
