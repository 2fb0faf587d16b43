"""Identify a curve: choose its samples, ask the database, run a method, judge the answer."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from skinlab.curve import FEWEST_POINTS, Curve
from skinlab.database.base import CurveModel, Database
from skinlab.errors import InputError, NotTrustworthyError
from skinlab.fem.suction import Geometry
from skinlab.identify.problem import Estimate, Options, Problem
from skinlab.identify.registry import get_method
from skinlab.identify.result import Identification, Provenance, Value
from skinlab.materials.compressibility import KappaConvention, kappa_ratio, nu_consistent
from skinlab.parameters import PAPER_BOX

Array = NDArray[np.float64]

_AT_BOUND = 1e-5  # of the parameter's range

PAPERS_METHODS = frozenset(
    {"sto", "hka", "gn", "gn-linesearch", "rls"}
)  # they search where the paper does, whatever the database


@dataclass(frozen=True)
class Identifier:
    """How to identify curves; the same for all curves of a run.

    `clock` only fills the field `seconds`.
    """

    database: Database
    method: str = "auto"
    options: Options = field(default_factory=Options)
    seed: int = 0
    kappa: KappaConvention = "paper"
    phases: tuple[str, ...] = ("load",)
    clock: Callable[[], float] = time.perf_counter

    def provenance(self) -> Provenance:
        """Return what a reader of the result must know to repeat it."""
        model = f"{self.database.law} kappa={self.kappa} mesh={self.database.mesh_name}"
        return Provenance(
            model_name="base",
            model_hash="sha256:" + hashlib.sha256(model.encode()).hexdigest(),
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
        method = get_method(self.method)
        started = self.clock()
        try:
            fitted, model, problem = self._problem(curve)
        except (InputError, NotTrustworthyError) as error:
            outside = isinstance(error, NotTrustworthyError)
            return Identification(
                curve.name,
                curve.setup,
                str(error),
                points=len(curve),
                phases=self.phases,
                flags=("outside_database",) if outside else (),
            )
        estimate = method(problem, self.options, np.random.default_rng(self.seed))
        return self._answer(curve, fitted, model, problem, estimate, self.clock() - started)

    def _problem(self, curve: Curve) -> tuple[NDArray[np.bool_], CurveModel, Problem]:
        chosen = curve.in_phases(self.phases)
        fitted = chosen & self.database.covered(curve.pressure_mbar)
        if int(fitted.sum()) < FEWEST_POINTS:
            raise InputError(
                f"{curve.name}: {int(fitted.sum())} samples to fit in phases "
                f"{','.join(self.phases)}; expected at least {FEWEST_POINTS}"
            )
        geometry = Geometry(curve.setup.aperture_mm, curve.setup.thickness_mm)
        model = self.database.model(geometry, curve.pressure_mbar[fitted], self.kappa)
        misfit = model.misfit(curve.deflection_mm[fitted])
        space = PAPER_BOX if self.method in PAPERS_METHODS else model.space
        return fitted, model, Problem(space, misfit, int(fitted.sum()))

    def _answer(
        self,
        curve: Curve,
        fitted: NDArray[np.bool_],
        model: CurveModel,
        problem: Problem,
        estimate: Estimate,
        seconds: float,
    ) -> Identification:
        x = estimate.parameters
        unit = problem.space.to_unit(x)
        flags = [
            f"at_bound:{name}"
            for name, at in zip(problem.space.names, unit, strict=True)
            if min(at, 1 - at) <= _AT_BOUND
        ]
        if curve.in_phases(self.phases).sum() > fitted.sum():
            flags.append("outside_database")
        if not estimate.converged:
            flags.append("not_converged")
        if curve.setup.cycle != 1:
            flags.append("not_first_cycle")
        if curve.partial:
            flags.append("partial_curve")
        ratio = float(kappa_ratio(x[2], self.kappa))
        model_mm = np.full(len(curve), np.nan)
        model_mm[fitted] = model.deflection_mm(x[None])[0]
        return Identification(
            curve.name,
            curve.setup,
            None,
            points=len(curve),
            phases=self.phases,
            parameters={n: Value(float(v)) for n, v in zip(problem.space.names, x, strict=True)},
            nu_consistent=float(nu_consistent(ratio)),
            kappa_MPa=ratio * float(x[0]),
            error_um=estimate.error_um,
            rms_um=estimate.error_um * float(np.sqrt(problem.points)),
            iterations=estimate.iterations,
            evaluations=estimate.evaluations,
            seconds=seconds,
            flags=tuple(flags),
            fitted=fitted,
            model_mm=model_mm,
        )
