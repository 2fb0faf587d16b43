"""Identification with a custom model: other bounds and priors, or effects in the law."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.campaign import Campaign
from skinlab.curves.corrected import as_read
from skinlab.curves.curve import Curve
from skinlab.discrepancy.fit import Fit, Fitter
from skinlab.discrepancy.misfit import errors_of
from skinlab.discrepancy.posterior import Posterior, sample
from skinlab.discrepancy.records import records_of
from skinlab.discrepancy.search import Search
from skinlab.discrepancy.settings import ERRORS
from skinlab.discrepancy.table_domes import TableDomes
from skinlab.errors import InputError, NotTrustworthyError
from skinlab.inference import flags
from skinlab.inference.identify import Identifier
from skinlab.inference.intervals import most_of_the_range
from skinlab.inference.joint import GaussianPrior
from skinlab.inference.result import Identification, Value
from skinlab.inference.samples import EVERYTHING, choose
from skinlab.mechanics.effects import get_effect
from skinlab.mechanics.materials import get_law
from skinlab.mechanics.model_file import Model, Normal
from skinlab.parameters import Space
from skinlab.tables.forward import check_law_of

Array = NDArray[np.float64]

_PRIOR_DRAWS = 2000


def with_model(identifier: Identifier, model: Model) -> Identifier:
    """Return the identifier with a model: its bounds and priors, and its effects.

    Raises:
        InputError: the method cannot take effects, or the database is of another law.
    """
    check_law_of(identifier.database, model.model.law)
    if model.effects:
        if identifier.method != "auto":
            raise InputError(
                f"method {identifier.method}: a model with effects needs --method auto"
            )
        given = {f.name: getattr(identifier, f.name) for f in fields(identifier)}
        return ModelIdentifier(**given | {"kappa": model.model.kappa, "model": model})
    space, priors = _space_of(model)
    return replace(identifier, kappa=model.model.kappa, space=space, priors=priors, model=model)


def _space_of(model: Model) -> tuple[Space | None, tuple[GaussianPrior, ...]]:
    """Return where to search and what is known beforehand, of a model without effects."""
    if not model.parameters:
        return None, ()
    space = model.space
    priors = tuple(
        GaussianPrior(i, prior.mean, prior.sd)
        for i, name in enumerate(space.names)
        if isinstance(prior := model.prior(name), Normal)
    )
    return space, priors


@dataclass(frozen=True)
class ModelIdentifier(Identifier):
    """Identification by a law with effects: finite elements where the database cannot speak."""

    def growing(self, curve: Curve, previous: Identification | None = None) -> Identification:
        """Return a quick answer by the base law: the effects wait for the whole curve."""
        return Identifier(self.database, kappa=self.kappa, phases=("load",)).growing(
            curve, previous
        )

    def _identify(
        self,
        curves: Sequence[Curve],
        blank: Identification,
        *,
        intervals: bool = True,
        start: Array | None = None,
    ) -> Identification:
        del intervals, start
        started = self.clock()
        history = any(get_effect(name).needs_history for name in self.model.effects)
        phases = EVERYTHING if history else self.phases
        blank = replace(blank, phases=phases)
        if self.model.learned_from({curve.source for curve in curves if curve.source}):
            # Data that the priors come from would count twice
            once = replace(self, model=self.model.without_learned())
            found = once._identify(curves, blank)
            return replace(found, flags=(*found.flags, "learned_from_these"))
        try:
            fit, fitter, p_value = self._fit(curves, phases)
        except (InputError, NotTrustworthyError) as error:
            outside = isinstance(error, NotTrustworthyError)
            flags = ("outside_database",) if outside else ()
            return replace(blank, error=str(error), flags=flags)
        answer = self._answer_of(curves, blank, fit, fitter, p_value)
        return replace(answer, seconds=self.clock() - started)

    def _fit(self, curves: Sequence[Curve], phases: tuple[str, ...]) -> tuple[Fit, Fitter, float]:
        if self.database.fixed_geometry is not None:
            raise InputError(
                "a model with effects needs a dimensionless database, or one of its own"
            )
        true = self.corrected(curves)
        chosen = tuple(choose(curve, phases, self.database).samples for curve in true)
        campaign = Campaign("", self.sensor.noise_um, self.sensor.pressure_noise_mbar, chosen)
        records = records_of(campaign)
        fitter = Fitter(records, errors_of(records), TableDomes(self.database))
        search = Search(fitter, model=self.model)
        base = search.base()
        return base.fit, search.fitter, base.left.p_value

    def _answer_of(
        self,
        curves: Sequence[Curve],
        blank: Identification,
        fit: Fit,
        fitter: Fitter,
        p_value: float,
    ) -> Identification:
        left = sample(fitter, fit, np.random.default_rng(self.seed))
        values = {n: Value(v["value"], v["low"], v["high"]) for n, v in left.parameters.items()}
        off = np.concatenate(fit.deflections_mm) - fitter.measured
        n = len(off)
        rms_um = 1e3 * float(np.sqrt(np.mean(off**2)))
        law = get_law(self.model.model.law)
        base = {n: v.value for n, v in values.items() if n in law.names}
        noises = [r.noise_um**2 for r in fitter.records]
        noise = float(np.sqrt(np.average(noises, weights=[len(r.curve) for r in fitter.records])))
        mask, model_mm = None, None
        if len(curves) == 1:
            (true,) = self.corrected(curves)
            mask = choose(true, blank.phases, self.database).mask
            model_mm = np.full(len(curves[0]), np.nan)
            (record,) = fitter.records
            _, model_mm[mask] = as_read(record.curve, record.pressure_mbar, fit.deflections_mm[0])
        return replace(
            blank,
            parameters=values,
            optimum=fit.unknowns.named(fit.u),
            correlation=left.correlation,
            derived=dict(law.derived(base, self.kappa)),
            own_bounds=tuple(self.model.parameters),
            error_um=rms_um / math.sqrt(n),
            rms_um=rms_um,
            noise_um=noise,
            flags=_flags(curves, fit, left, p_value, self.seed),
            fitted=mask,
            fitted_points=n,
            model_mm=model_mm,
        )


def _flags(
    curves: Sequence[Curve], fit: Fit, left: Posterior, p_value: float, seed: int
) -> tuple[str, ...]:
    low, high = fit.unknowns.bounds
    found = flags.of_optimum(
        fit.unknowns.names, (fit.u - low) / (high - low), converged=fit.settled
    )
    found += flags.of_curves(curves, [0])
    space, count = fit.unknowns.space, fit.unknowns.count
    prior = space.from_unit(np.random.default_rng(seed).random((_PRIOR_DRAWS, count)))
    for j, name in enumerate(fit.unknowns.base_names):
        value = left.parameters[name]
        if most_of_the_range((value["low"], value["high"]), prior[:, j]):
            found.append(f"not_identifiable:{name}")
    if p_value < ERRORS.adequate:
        found.append("misfit_above_noise")
    return tuple(found)
