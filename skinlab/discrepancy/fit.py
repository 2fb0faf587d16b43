"""Fit one explanation to a campaign: the optimum, how sure it is, and its evidence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinlab.discrepancy.records import Record
from skinlab.discrepancy.settings import FITS
from skinlab.discrepancy.space_mapping import MappedModel
from skinlab.discrepancy.table_domes import TableDomes
from skinlab.discrepancy.unknowns import Unknowns
from skinlab.inference.covariance import Covariance
from skinlab.inference.optimise import polish
from skinlab.mechanics.fem.suction import MESH_OF_RECORD, SCREENING_MESH, Discretisation
from skinlab.parameters import Space

Array = NDArray[np.float64]

NO_MODEL = 1e3  # a whitened residual where there is no model
_DIFFERENCE = 1e-4


@dataclass(frozen=True, eq=False)
class Fit:
    """An explanation at its best."""

    unknowns: Unknowns
    u: Array  # (k,) optimum
    deflections_mm: list[Array]
    chi2: float  # of the data; priors not included
    cost: float  # with the priors, the law's and the effects'
    jacobian: Array  # (n, k) of whitened residuals
    settled: bool  # whether another anchor would change nothing
    corrected: bool  # whether finite elements corrected the table

    @property
    def effects(self) -> tuple[str, ...]:
        """The effects of the explanation."""
        return self.unknowns.effects

    def with_errors(self, before: Covariance, after: Covariance) -> Fit:
        """Return the same fit, whose slopes were whitened by `before`, whitened by `after`."""
        return replace(self, jacobian=after.whiten(before.colour(self.jacobian)))

    @property
    def information(self) -> Array:
        """JᵀJ with the priors (k, k)."""
        return self.unknowns.information(self.jacobian, self.u)

    @property
    def free(self) -> NDArray[np.bool_]:
        """Which unknowns (k,) may still give way to either side: those that are at no bound."""
        low, high = self.unknowns.bounds
        edge = FITS.at_bound * (high - low)
        return np.asarray((self.u > low + edge) & (self.u < high - edge))

    def is_near(self, u: Array) -> bool:
        """Return whether unknowns (k,) are so near that a fit from there would end here."""
        effects = np.ones(len(self.unknowns.axes))
        far = np.abs(u - self.u) / np.concatenate([self.unknowns.reaches, effects])
        return bool((far < FITS.near).all())

    @property
    def deviations(self) -> Array:
        """Standard deviations (k,) of the unknowns."""
        return np.asarray(np.sqrt(np.diag(np.linalg.inv(self.information))))


@dataclass(frozen=True, eq=False)
class Kept:
    """Some of a campaign's samples, and their errors."""

    samples: NDArray[np.bool_]
    errors: Covariance


class Limit(NamedTuple):
    """Costs above which a fit is out of the race, since others explain."""

    first: float = math.inf  # once the finite elements were asked a few times
    later: float = math.inf  # and once they were asked often: no first picture may be off any more

    @classmethod
    def at(cls, cost: float) -> Limit:
        """Return the same one, early and late."""
        return cls(cost, cost)


NO_LIMIT = Limit()


class Fitter:
    """Fits explanations to one campaign."""

    def __init__(
        self,
        records: Sequence[Record],
        errors: Covariance,
        domes: TableDomes,
        *,
        finite_elements: bool = True,
    ) -> None:
        """Without `finite_elements` effects that the table cannot answer stay approximate."""
        self.records, self.errors, self.domes = records, errors, domes
        self._finite_elements = finite_elements
        self.measured = np.concatenate([r.straight_mm for r in records])

    def with_errors(self, records: Sequence[Record], errors: Covariance) -> Fitter:
        """Return a fitter of these records with these errors."""
        found = copy(self)
        found.records, found.errors = records, errors
        found.measured = np.concatenate([r.straight_mm for r in records])
        return found

    def with_equal_errors(self, size_um: float) -> Fitter:
        """Return a fitter of the same records, of which all samples have independent errors."""
        variance = np.full(self.errors.count, (1e-3 * size_um) ** 2)
        plain = Covariance(variance, np.zeros((len(variance), 0)), self.errors.ends)
        return self.with_errors(self.records, plain)

    def by_own_errors(self, fit: Fit, errors: Covariance) -> Fit:
        """Return a fit by other `errors` as it counts by these."""
        cost, chi2 = self._costs(fit.unknowns, fit.u, fit.deflections_mm)
        return replace(fit.with_errors(errors, self.errors), chi2=chi2, cost=cost)

    def on_paths(self, fit: Fit) -> Fitter | None:
        """Return a fitter of the same records at their paths' pressures, None where they are there.

        A model that is evaluated at readings follows their noise by dw/dp, and the skin does not:
        what has a small slope would be likelier by that alone. So what the noise does to this fit's
        curves stays with the deflections, as an error, and slopes of others do not know of it
        (docs/decisions/0139-slopes-that-know-no-noise.md).
        """
        if not any(r.off_path_mbar.any() for r in self.records):
            return None
        mirrored = [
            replace(r, pressure_mbar=r.on_path_mbar - r.off_path_mbar) for r in self.records
        ]
        model = self.with_errors(mirrored, self.errors).model(fit.unknowns)
        if not self.prepare(model, fit.u):
            return None
        found = []
        for r, up, down in zip(self.records, fit.deflections_mm, model.predict(fit.u), strict=True):
            # Half of the difference, so that the curve's bend does not add up.
            off_mm = np.nan_to_num(0.5 * (up - down))
            found.append(replace(r, pressure_mbar=r.on_path_mbar, off_path_mm=off_mm))
        return self.with_errors(found, self.errors)

    def model(self, unknowns: Unknowns, mesh: Discretisation = MESH_OF_RECORD) -> MappedModel:
        """Return the model of an explanation, without an anchor."""
        return MappedModel(self.records, unknowns, self.domes, mesh)

    def prepare(
        self, model: MappedModel, u: Array, *, slopes: bool = False, memory: bool = True
    ) -> bool:
        """Solve the finite elements at u where they are to be used; False where they fail."""
        return not self._finite_elements or model.anchor(u, slopes=slopes, memory=memory)

    def kept(self, samples: NDArray[np.bool_]) -> Kept:
        """Return some of the samples (u,), with their errors, to be fitted alone."""
        return Kept(samples, self.errors.only(samples))

    def residuals_of_many(self, model: MappedModel, u: Array, keep: Kept | None = None) -> Array:
        """Return whitened residuals (candidates, n) of unknowns (candidates, k)."""
        off = np.hstack(model.predict_many(u)) - self.measured
        # What was measured was no crease: also where it is left out.
        held = np.isfinite(off).all(axis=1)
        errors = self.errors
        if keep is not None:
            off, errors = off[:, keep.samples], keep.errors
        found = np.full((len(u), errors.count), NO_MODEL)
        if held.any():
            found[held] = errors.whiten(off[held].T).T
        return found

    def jacobian(self, model: MappedModel, u: Array) -> Array:
        """Return derivatives (n, k) of whitened residuals, by differences inside the bounds."""
        return np.asarray(self.residuals_and_slopes(model, u[None])[1][0])

    def residuals_and_slopes(
        self, model: MappedModel, u: Array, keep: Kept | None = None
    ) -> tuple[Array, Array]:
        """Return residuals (candidates, n) and their derivatives (candidates, n, k)."""
        n, k = u.shape
        steps = np.where(u + _DIFFERENCE <= model.unknowns.bounds[1], _DIFFERENCE, -_DIFFERENCE)
        moved = u[:, None, :] + steps[:, None, :] * np.eye(k)
        every = np.concatenate([u[:, None, :], moved], axis=1).reshape(-1, k)
        found = self.residuals_of_many(model, every, keep).reshape(n, k + 1, -1)
        slopes = (found[:, 1:] - found[:, :1]) / steps[:, :, None]
        slopes = np.where(np.abs(slopes) < 0.1 * NO_MODEL / _DIFFERENCE, slopes, 0.0)
        return found[:, 0], np.asarray(slopes.transpose(0, 2, 1))

    def minimise(
        self,
        model: MappedModel,
        start: Array,
        low: Array,
        high: Array,
        keep: Kept | None = None,
        least_gain: float = FITS.least_gain,
    ) -> Array:
        """Return the optimum between bounds, of the model as it is now."""
        space = Space.box(model.unknowns.names, low.tolist(), high.tolist())
        found = polish(
            space, Misfit(self, model, keep), space.to_unit(start)[None],
            least_gain=least_gain, most_iterations=FITS.steps,
        )  # fmt: skip
        return np.asarray(space.from_unit(found.unit)[0])

    def fit(
        self,
        unknowns: Unknowns,
        start: Array,
        limit: Limit = NO_LIMIT,
        known: Fit | None = None,
    ) -> Fit | None:
        """Return the best fit near a start (k,), None where there is no model.

        A walk that has not settled is begun anew from where it ended, until nothing is gained. A
        fit that will not come below a `limit` ends early and is not settled; so does one that, a
        little later, will not come below the cost of a fit of the same explanation which is
        `known`. Where it leads to that one, that one is returned.
        """
        least = math.inf if known is None else known.cost
        if not self._finite_elements:
            return self._walk(self.model(unknowns), start, limit, least)[0]
        # On a coarse mesh first: an effect is nearly the same there, at a quarter of the time.
        best, last = self._walked(self.model(unknowns, SCREENING_MESH), start, limit, least)
        hopeless = min(FITS.hopeless * self.errors.count, limit.later)
        if best is None:
            best, last = self._walked(self.model(unknowns), start, limit, least)
        elif best.corrected and best.chi2 <= hopeless:
            if known is not None and known.settled and known.is_near(best.u):
                return known
            near = best
            best, last = self._walked(last.exact(), near.u, limit, least, near=True)
            if best is None:  # a skin that creases on the finer mesh alone
                best, last = self._walked(self.model(unknowns), start, limit, least)
        if best is None or not best.corrected or best.chi2 > hopeless:
            return best
        return self._anchored(best, last)

    def near(self, fit: Fit) -> Fit | None:
        """Return the best fit near one by other errors: no coarse mesh has to lead there.

        These are what is compared in the end: it goes on along a long valley.
        """
        model = self.model(fit.unknowns)
        best, last = self._walked(model, fit.u, NO_LIMIT, math.inf, near=True)
        return best if best is None else self._anchored(best, last)

    def _anchored(self, best: Fit, last: MappedModel) -> Fit:
        """Return a fit with its curves and slopes as finite elements tell them there."""
        model = last.exact()
        if not model.anchor(best.u):
            return best
        final = self.at(model, best.u)
        return best if final is None else replace(final, settled=best.settled)

    def _walked(
        self,
        model: MappedModel,
        start: Array,
        limit: Limit,
        known: float,
        *,
        near: bool = False,
    ) -> tuple[Fit | None, MappedModel]:
        """Return where a model leads, begun anew where it has not settled."""
        best, last = self._walk(model, start, limit, known, near=near)
        for _ in range(FITS.walks):
            hopeless = min(FITS.hopeless * self.errors.count, limit.later)
            if best is None or best.settled or not best.corrected or best.chi2 > hopeless:
                break
            again, after = self._walk(model.anew(), best.u, limit, known, near=near)
            least = self._worth(best, model)
            if again is None or again.cost > best.cost - least:
                break
            best, last = again, after
        return best, last

    def refined(self, fit: Fit) -> Fit:
        """Return a fit moved to the optimum by these errors, its finite elements kept."""
        model = self.model(fit.unknowns)
        if not self.prepare(model, fit.u, slopes=True):
            return fit
        low, high = fit.unknowns.bounds
        near = np.concatenate([fit.unknowns.reaches, np.full(len(fit.unknowns.axes), 1.0)])
        low, high = np.maximum(low, fit.u - near), np.minimum(high, fit.u + near)
        found = self.at(model, self.minimise(model, fit.u, low, high))
        return fit if found is None else found

    def sharpened(self, fit: Fit, errors: Covariance) -> Fit:
        """Return a fit moved to the optimum by other errors; its figures are by its own ones."""
        other = self.with_errors(self.records, errors)
        found = other.near(fit) if fit.corrected else other.fit(fit.unknowns, fit.u)
        if found is None:
            return fit
        return self.by_own_errors(found, errors)

    def _walk(
        self,
        model: MappedModel,
        start: Array,
        limit: Limit,
        known: float,
        *,
        near: bool = False,
    ) -> tuple[Fit | None, MappedModel]:
        """Return where one model, corrected from anchor to anchor, leads, and the model there.

        `near`: it begins where a coarser mesh has led, and may end there. On the mesh of record it
        goes on where a step came out as expected, as long as slopes from there promise more.
        """
        unknowns = model.unknowns
        low, high = unknowns.bounds
        if self._finite_elements and not model.anchor(start):
            return None, model
        if not model.corrected:
            u = self.minimise(model, start, low, high)
            return self.at(model, u), model
        effects = np.full(len(unknowns.axes), FITS.effect_radius)
        widest = np.concatenate([unknowns.reaches, effects])
        radius = widest
        best = self.at(model, start)
        if best is None:
            return None, model
        settled = False
        idle = 0
        for k in range(FITS.anchors):
            before = best.cost
            missing = max(0.0, best.chi2 - self.errors.count)
            least = self._worth(best, model)
            u = self.minimise(
                model,
                best.u,
                np.maximum(low, best.u - radius),
                np.minimum(high, best.u + radius),
                least_gain=max(FITS.least_gain, FITS.least_gain_share * missing),
            )
            expected = model.predict(u)
            hoped, _ = self._costs(unknowns, u, expected)
            lowest = min(best.cost, hoped)
            if (k >= FITS.seen_anchors and lowest > limit.first) or (
                k >= FITS.enough_anchors and lowest > min(known, limit.later)
            ):
                settled = False
                break
            # As far as the slopes tell, this is the bottom.
            if (k or near) and hoped > best.cost - least:
                settled = True
                break
            if not model.anchor(u):
                radius = 0.4 * radius
                model = model.anew()
                model.anchor(best.u)
                continue
            found = self.at(model, u)
            if found is None:
                radius = 0.4 * radius
                continue
            close = FITS.close + FITS.close_share * max(0.0, found.chi2 - self.errors.count)
            well = self._change(found.deflections_mm, expected) < close
            at_edge = bool((np.abs(u - best.u) > 0.98 * radius).any())
            settled = well and not at_edge
            if found.cost > best.cost:
                radius = 0.4 * radius
                if not well:
                    model.anchor(best.u)
            else:
                best = found
                if well:
                    radius = np.minimum(2.5 * radius, widest)
            # A flat valley: another anchor moves along it and gains nothing, whatever is promised:
            # answers of meshes that differ by a hair differ by so much.
            gains = before - found.cost
            nothing = abs(gains) < least or (gains < least and before - hoped < FITS.hair)
            idle = idle + 1 if nothing else 0
            if idle >= FITS.idle_anchors:
                settled = True
            stuck = k >= FITS.enough_anchors and best.cost > before - FITS.worth * (
                best.chi2 - self.errors.count
            )
            more = model.sloped and not model.coarse and well and idle < FITS.idle_anchors
            end = settled and not more
            if end or (stuck and best.chi2 > 2.0 * FITS.hopeless * self.errors.count):
                break
        return replace(best, settled=settled), model

    def _worth(self, best: Fit, model: MappedModel) -> float:
        """Return the gain of the cost for which a fit goes on."""
        least = FITS.hair if model.coarse else FITS.gain
        return least + FITS.close_share * max(0.0, best.chi2 - self.errors.count)

    def _change(self, now: list[Array], before: list[Array]) -> float:
        off = self.errors.whiten(np.concatenate(now) - np.concatenate(before))
        return float(off @ off)

    def _costs(self, unknowns: Unknowns, u: Array, predicted: list[Array]) -> tuple[float, float]:
        """Return the cost with the priors, and χ² of the data alone."""
        off = np.concatenate(predicted) - self.measured
        if not np.isfinite(off).all():
            return math.inf, math.inf
        r, prior = self.errors.whiten(off), unknowns.prior_rows(u)
        cost = float(r @ r + prior @ prior)
        return cost, cost - float(prior @ prior)

    def at(self, model: MappedModel, u: Array) -> Fit | None:
        """Return the fit that these unknowns (k,) are; None where there is no model."""
        unknowns, predicted = model.unknowns, model.predict(u)
        cost, chi2 = self._costs(unknowns, u, predicted)
        if not math.isfinite(cost):
            return None
        return Fit(
            unknowns, u, predicted, chi2, cost, self.jacobian(model, u),
            settled=True, corrected=model.corrected,
        )  # fmt: skip


@dataclass(eq=False)
class Misfit:
    """A fit's whitened residuals and priors, of many candidates at once.

    Whoever asks for residuals and then for slopes there gets both out of one batch.
    """

    fitter: Fitter
    model: MappedModel
    keep: Kept | None = None
    rest: float = 0.0
    _known: tuple[Array, Array] | None = None  # parameters, and the slopes there

    def __call__(self, parameters: Array) -> Array:
        """Return χ² (n,) with the priors; infinite where there is no model."""
        each = self.fitter.residuals_of_many(self.model, parameters, self.keep)
        cost = np.square(each).sum(axis=1) + np.square(self.priors(parameters)).sum(axis=1)
        return np.where((each == NO_MODEL).all(axis=1), np.inf, cost)

    def differences(self, parameters: Array) -> Array:
        """Return residuals (n, m); large where there is no model."""
        found, slopes = self.fitter.residuals_and_slopes(self.model, parameters, self.keep)
        self._known = parameters, slopes
        return np.hstack([found, self.priors(parameters)])

    def slopes(self, parameters: Array) -> Array:
        """Return derivatives (n, m, k) of `differences`."""
        known, self._known = self._known, None
        if known is None or known[0] is not parameters:
            _, found = self.fitter.residuals_and_slopes(self.model, parameters, self.keep)
            known = parameters, found
        priors = [self.model.unknowns.prior_slopes(u) for u in parameters]
        return np.concatenate([known[1], np.array(priors)], axis=1)

    def priors(self, parameters: Array) -> Array:
        """Return deviations (n, priors) from what is known beforehand."""
        priors = [self.model.unknowns.prior_rows(u) for u in parameters]
        return np.array(priors).reshape(len(parameters), -1)
