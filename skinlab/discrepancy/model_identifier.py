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
from skinlab.discrepancy.unlike import contradicted
from skinlab.errors import BrokenPluginError, InputError, NotTrustworthyError
from skinlab.inference import flags
from skinlab.inference.error_judgement import judge_errors
from skinlab.inference.identify import Identifier
from skinlab.inference.intervals import most_of_the_range
from skinlab.inference.joint import GaussianPrior
from skinlab.inference.result import Identification, Value
from skinlab.inference.samples import EVERYTHING, Fitted, choose, glitches_of, outliers_by_file
from skinlab.mechanics.materials import get_law
from skinlab.mechanics.model_file import Model
from skinlab.parameters import Space
from skinlab.plugins import blaming
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
    return space, tuple(GaussianPrior(*known) for known in model.normal_priors(space))


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
        phases = EVERYTHING if self.model.needs_history else self.phases
        blank = replace(blank, phases=phases)
        if self.model.learned_from({curve.source for curve in curves if curve.source}):
            # Data that the priors come from would count twice
            once = replace(self, model=self.model.without_learned())
            found = once._identify(curves, blank)
            return replace(found, flags=(*found.flags, "learned_from_these"))
        try:
            with blaming():
                answer, unlike = self._answered(curves, blank)
        except (InputError, NotTrustworthyError, BrokenPluginError) as error:
            outside = isinstance(error, NotTrustworthyError)
            flags = ("outside_database",) if outside else ()
            return replace(blank, error=str(error), flags=flags)
        if unlike:
            alone = replace(self, model=self.model.without_learned())
            found = alone._identify(curves, blank)
            answer = replace(found, flags=(*found.flags, *(f"unlike_model:{e}" for e in unlike)))
        return replace(answer, seconds=self.clock() - started)

    def _answered(
        self, curves: Sequence[Curve], blank: Identification
    ) -> tuple[Identification, list[str]]:
        """Return the answer, and effects of which the curves contradict what the model says."""
        if self.database.fixed_geometry is not None:
            raise InputError(
                "a model with effects needs a dimensionless database, or one of its own"
            )
        members = [choose(c, blank.phases, self.database) for c in self.corrected(curves)]
        sensor = self.sensor
        campaign = Campaign(
            "", sensor.noise_um, sensor.pressure_noise_mbar, tuple(m.samples for m in members)
        )
        records = records_of(campaign, every=True)
        search = Search(
            Fitter(records, errors_of(records), TableDomes(self.database)),
            model=self.model,
            noise_um=sensor.noise_um,
            placement_scatter=sensor.placement_scatter,
        )
        base = search.learned_base()
        # The errors as this model sees them: there is no other explanation.
        errors = search.errors.looks[-1]
        fitter, fit = search.as_last_seen(base.fit)
        unlike = contradicted(fitter, fit)
        if unlike:
            return blank, unlike
        left = sample(fitter, fit, errors, np.random.default_rng(self.seed))
        off = np.concatenate(fit.deflections_mm) - fitter.measured
        rms_um = 1e3 * float(np.sqrt(np.mean(off**2)))
        judged = judge_errors(errors, sensor.noise_um, rms_um)
        left_out = sum(int((~k).sum()) for k in search.kept) + glitches_of(members)
        said = (
            *_flags(members, fit, left, self.seed),
            *self._pressure_flags(members),
            *judged.flags,
            *(["misfit_above_noise"] if base.left.p_value < ERRORS.adequate else []),
            *([f"outliers:{left_out}"] if left_out else []),
        )
        law = get_law(self.model.model.law)
        values = {n: Value(v["value"], v["low"], v["high"]) for n, v in left.parameters.items()}
        own = {n: v.value for n, v in values.items() if n in law.names}
        found = replace(
            blank,
            parameters=values,
            optimum=fit.unknowns.named(fit.u),
            correlation=left.correlation,
            derived=dict(law.derived(own, self.kappa)),
            # Of an effect no database says how far it may go.
            own_bounds=(*self.model.parameters, *(axis.name for axis in fit.unknowns.axes)),
            error_um=rms_um / math.sqrt(len(off)),
            rms_um=rms_um,
            noise_um=judged.noise_um,
            error_model=judged.summary,
            placement=judged.placement,
            flags=tuple(dict.fromkeys(said)),
            fitted_points=len(off),
        )
        if len(curves) > 1:
            return replace(found, outliers_by_file=outliers_by_file(members, search.kept)), []
        return _drawn(found, members[0], search.kept[0], fitter, fit), []


def _drawn(
    found: Identification, member: Fitted, kept: NDArray[np.bool_], fitter: Fitter, fit: Fit
) -> Identification:
    """Return the answer for one curve, with its fitted curve at all samples that were chosen."""
    (record,) = fitter.records
    _, deflection = as_read(record.curve, record.pressure_mbar, fit.deflections_mm[0])
    time = member.curve.time_s[member.mask]
    fitted, outliers = member.mask.copy(), np.zeros(len(member.mask), dtype=bool)
    fitted[member.mask], outliers[member.mask] = kept, ~kept
    if member.glitches is not None:
        outliers |= member.glitches
    model_mm = np.full(len(member.mask), np.nan)
    model_mm[member.mask] = np.interp(time, time[kept], deflection)
    return replace(found, fitted=fitted, outliers=outliers, model_mm=model_mm)


def _flags(members: Sequence[Fitted], fit: Fit, left: Posterior, seed: int) -> tuple[str, ...]:
    low, high = fit.unknowns.bounds
    found = flags.of_optimum(
        fit.unknowns.names, (fit.u - low) / (high - low), converged=fit.settled
    )
    found += flags.of_curves([m.curve for m in members], [m.beyond for m in members])
    found += [f"thinned:{m.every}" for m in members if m.every > 1]
    space, count = fit.unknowns.space, fit.unknowns.count
    prior = space.from_unit(np.random.default_rng(seed).random((_PRIOR_DRAWS, count)))
    for j, name in enumerate(fit.unknowns.base_names):
        value = left.parameters[name]
        if most_of_the_range((value["low"], value["high"]), prior[:, j]):
            found.append(f"not_identifiable:{name}")
    return tuple(found)
