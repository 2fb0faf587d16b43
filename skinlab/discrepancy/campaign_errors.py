"""The errors of a campaign, learned without believing any explanation, and alike for all of them.

What repeats and roughness say (pure error): polynomials in time, free for every phase of every
condition but common to its repeats, stand for whatever a model may miss. What is left tells of the
noise, how long it lasts, its steps, breathing, and of how placements differ. Each explanation is
then judged with the errors' parameters integrated out: "people place the probe differently" is
weighed against every effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.special import logsumexp

from skinlab.discrepancy.campaign_error_models import models_of
from skinlab.discrepancy.fit import Fit
from skinlab.discrepancy.misfit import columns_of, pressure_errors_mm, slopes_mm_per_mbar
from skinlab.discrepancy.placement_curves import softer_mm
from skinlab.discrepancy.records import Record, by_condition
from skinlab.discrepancy.settings import ERRORS
from skinlab.inference.covariance import Covariance, gram_matrices, products, products_of
from skinlab.inference.error_choice import ErrorChoice, Node, choose_errors
from skinlab.inference.error_models.base import ErrorModel, Look
from skinlab.inference.error_models.quantised import steps_of_samples_mm
from skinlab.inference.error_models.words import of_size
from skinlab.inference.likelihood import LinearModel
from skinlab.inference.noise import (
    MESH_REST,
    legendre,
)
from skinlab.inference.outliers import SPREAD, outlier_probability
from skinlab.inference.samples import Samples, alike
from skinlab.inference.settings import NOISE

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_TOGETHER = 40  # columns of explanations whose products are taken at once
_LOG_2PI = float(np.log(2.0 * np.pi))


@dataclass(frozen=True, eq=False)
class Linearised:
    """An explanation about its fit: r = r0 − J δ, with its priors."""

    residual_mm: Array  # (u,) measured − model
    slopes_mm: Array  # (u, k)
    free: Mask  # (k,) unknowns at no bound
    prior: Array  # (priors,) deviations at the fit
    prior_slopes: Array  # (priors, k)
    flat: Array  # (k, k) precision of the flat priors
    log_prior_volume: float

    @classmethod
    def of(cls, fit: Fit, errors: Covariance, measured_mm: Array) -> Linearised:
        """Return it at a fit, whose slopes were whitened by these errors."""
        unknowns, k = fit.unknowns, len(fit.u)
        slopes = unknowns.prior_slopes(fit.u)
        flat = unknowns.information(np.zeros((0, k)), fit.u) - slopes.T @ slopes
        return cls(
            measured_mm - np.concatenate(fit.deflections_mm),
            errors.colour(fit.jacobian),
            fit.free,
            unknowns.prior_rows(fit.u),
            slopes,
            flat,
            unknowns.log_prior_volume,
        )

    def only(self, kept: Mask) -> Linearised:
        """Return the same of some samples (u,)."""
        return Linearised(
            self.residual_mm[kept], self.slopes_mm[kept], self.free, self.prior, self.prior_slopes,
            self.flat, self.log_prior_volume,
        )  # fmt: skip

    def without(self, index: int, log_width: float) -> Linearised:
        """Return it with one unknown held, whose flat prior has this width."""
        kept = np.arange(len(self.free)) != index
        return Linearised(
            self.residual_mm, self.slopes_mm[:, kept], self.free[kept], self.prior,
            self.prior_slopes[:, kept], _sub(self.flat, kept), self.log_prior_volume - log_width,
        )  # fmt: skip

    def beside(self, columns_mm: Array) -> Linearised:
        """Return it with columns (u, m) of one standard deviation each beside its unknowns."""
        m, k = columns_mm.shape[1], len(self.free)
        slopes = np.zeros((len(self.prior) + m, k + m))
        slopes[: len(self.prior), :k] = self.prior_slopes
        slopes[len(self.prior) :, k:] = np.eye(m)
        flat = np.zeros((k + m, k + m))
        flat[:k, :k] = self.flat
        return Linearised(
            self.residual_mm,
            np.hstack([self.slopes_mm, columns_mm]),
            np.concatenate([self.free, np.ones(m, dtype=bool)]),
            np.concatenate([self.prior, np.zeros(m)]),
            slopes,
            flat,
            self.log_prior_volume + 0.5 * m * _LOG_2PI,
        )

    def scaled(self, size: float, m: int) -> Linearised:
        """Return it with standard deviations `size` of its last m unknowns, `beside`'s columns."""
        slopes = self.prior_slopes.copy()
        slopes[-m:] /= size
        volume = self.log_prior_volume + m * float(np.log(size))
        return replace(self, prior_slopes=slopes, log_prior_volume=volume)

    def log_density(
        self, products_: Array, log_determinant: Array, samples: int | None = None
    ) -> Array:
        """Return log p(data | errors) (n,), the unknowns integrated out, for n covariances.

        `products_` (n, 1 + k, 1 + k) are those of residual and slopes by their inverses, over all
        samples or so many of them.
        """
        k = len(self.free)
        whole = products_[:, 1:, 1:] + self.prior_slopes.T @ self.prior_slopes + self.flat
        right = products_[:, 1:, 0] - self.prior_slopes.T @ self.prior
        free = self.free
        moving, score = whole[:, free][:, :, free], right[:, free]
        taken = np.linalg.solve(moving, score[:, :, None])[:, :, 0]
        chi2 = products_[:, 0, 0] + self.prior @ self.prior - (score * taken).sum(axis=1)
        log_det = np.linalg.slogdet(whole)[1] + log_determinant
        n = len(self.residual_mm) if samples is None else samples
        return np.asarray(
            -0.5 * (n * _LOG_2PI + log_det + chi2 - k * _LOG_2PI) - self.log_prior_volume
        )

    def explained_mm(self, errors: Covariance) -> Array:
        """Return by how much the curves (u,) move where the unknowns go to their optimum."""
        slopes = self.slopes_mm[:, self.free]
        both = errors.whiten(np.column_stack([slopes, self.residual_mm]))
        white, left = both[:, :-1], both[:, -1]
        prior = self.prior_slopes[:, self.free]
        whole = white.T @ white + prior.T @ prior + _sub(self.flat, self.free)
        moved = np.linalg.solve(whole, white.T @ left - prior.T @ self.prior)
        return np.asarray(slopes @ moved)

    def shares(self, errors: Covariance) -> Array:
        """Return what each of the errors' columns probably did (u, m), mm."""
        return self.of_free.shares(errors, self.prior_slopes[:, self.free].T @ self.prior)

    @property
    def of_free(self) -> LinearModel:
        """The same of the unknowns that are at no bound, about the fit."""
        precision = self.flat + self.prior_slopes.T @ self.prior_slopes
        return LinearModel(
            self.residual_mm, self.slopes_mm[:, self.free], _sub(precision, self.free)
        )


@dataclass(frozen=True, eq=False)
class CampaignErrors:
    """What the errors of a campaign may be: settings with their weights, of several looks.

    Each look (pure error first; the model as it is; the best explanation) explored the same prior
    where it saw likely settings: their mean integrates over all that any explanation prefers.
    """

    looks: tuple[ErrorChoice, ...]

    @property
    def pure(self) -> ErrorChoice:
        """What repeats and roughness say."""
        return self.looks[0]

    @property
    def working(self) -> Covariance:
        """The covariance by which explanations are fitted."""
        return self.pure.mode

    @property
    def implausible(self) -> str:
        """What is too large for an error, as the best explanation leaves it; empty if nothing."""
        look, found = self.looks[-1], []
        for name, most in ERRORS.largest_um.items():
            size = look.median(partial(size_um, name=name))
            if size > most:
                found.append(f"{of_size(name, size)} (more than {most:g} µm is no error)")
        return ", ".join(found)

    def weights(self, ones: Sequence[Linearised]) -> list[tuple[Node, float]]:
        """Return the settings of all looks, with how probable each is by these explanations."""
        nodes = [node for look in self.looks for node in look.nodes[: ERRORS.judged_nodes]]
        found = log_evidences(ones, [n.covariance for n in nodes])
        found += np.array([[n.log_prior] for n in nodes])
        share = np.exp(found - logsumexp(found, axis=0)).mean(axis=1)
        return list(zip(nodes, share.tolist(), strict=True))

    def log_evidences(self, ones: Sequence[Linearised], most: int | None = None) -> Array:
        """Return log p(data) (explanations,), errors' parameters integrated out.

        With `most` over so many of the likeliest settings of each look: roughly.
        """
        return averaged([evidences_of_look(look, ones, most) for look in self.looks])


def evidences_of_look(
    look: ErrorChoice, ones: Sequence[Linearised], most: int | None = None
) -> Array:
    """Return log p(data) (explanations,), the errors' parameters integrated out as one look has it.

    With `most` over so many of the likeliest settings.
    """
    below = np.cumsum(look.weight) - look.weight
    count = min(int((below < ERRORS.weight_kept).sum()), most or len(below))
    nodes = look.nodes[:count]
    found = log_evidences(ones, [n.covariance for n in nodes])
    return np.asarray(logsumexp(found + np.array([[n.log_prior] for n in nodes]), axis=0))


def averaged(each: Sequence[Array]) -> Array:
    """Return log p(data) (explanations,) of several looks (each), which are equally good."""
    return np.asarray(logsumexp(each, axis=0) - np.log(len(each)))


def likeliest(look: ErrorChoice) -> list[tuple[Covariance, float]]:
    """Return the likeliest settings of a look, with weights that sum up to 1."""
    nodes = look.nodes[: ERRORS.judged_nodes]
    weight = look.weight[: len(nodes)]
    return [(n.covariance, float(w)) for n, w in zip(nodes, weight / weight.sum(), strict=True)]


def log_evidences(ones: Sequence[Linearised], covariances: Sequence[Covariance]) -> Array:
    """Return log p(data | errors) (covariances, explanations) of the same samples."""
    values, widths = _side_by_side(ones)
    found = np.empty((len(covariances), len(ones)))
    for members, (some, columns) in product(_alike(covariances), _few(widths)):
        every, log_determinant = products([covariances[i] for i in members], values[:, columns])
        for j in some:
            own = np.searchsorted(columns, widths[j])
            found[members, j] = ones[j].log_density(every[:, own[:, None], own], log_determinant)
    return found


def _few(widths: Sequence[NDArray[np.intp]]) -> list[tuple[list[int], list[int]]]:
    """Return explanations whose columns are taken together, and the columns, ascending.

    Nobody asks for products of one explanation's slopes with another's: of a hundred explanations
    these were most of the work.
    """
    groups: list[tuple[list[int], set[int]]] = []
    for j, own in enumerate(widths):
        if not groups or len(groups[-1][1].union(own.tolist())) > _TOGETHER:
            groups.append(([], set()))
        groups[-1][0].append(j)
        groups[-1][1].update(own.tolist())
    return [(some, sorted(columns)) for some, columns in groups]


class WithoutCurves:
    """`log_evidences` of whole curves, any of them left out: what each one says is added up."""

    def __init__(self, ones: Sequence[Linearised], covariances: Sequence[Covariance]) -> None:
        """Take what every curve says once."""
        self._ones, self._count = ones, len(covariances)
        values, self._widths = _side_by_side(ones)
        self._m = values.shape[1]
        ends = covariances[0].ends
        number = np.searchsorted(ends, np.arange(len(values)), side="right")
        self._each: list[tuple[list[int], list[tuple[Array, Array]]]] = []
        for members in _alike(covariances):
            parts = []
            for i in range(len(ends)):
                here = number == i
                cut = [covariances[k].only(here) for k in members]
                parts.append(gram_matrices(cut, values[here]))
            self._each.append((members, parts))

    def __call__(self, curves: NDArray[np.bool_], samples: int) -> Array:
        """Return log p (covariances, explanations) of some curves, which have so many samples."""
        found = np.empty((self._count, len(self._ones)))
        for members, parts in self._each:
            kept = [part for part, is_in in zip(parts, curves, strict=True) if is_in]
            gram, log_base = sum(g for g, _ in kept), sum(d for _, d in kept)
            every, log_determinant = products_of(np.asarray(gram), np.asarray(log_base), self._m)
            for j, (one, own) in enumerate(zip(self._ones, self._widths, strict=True)):
                found[members, j] = one.log_density(
                    every[:, own[:, None], own], log_determinant, samples
                )
        return found


def _alike(covariances: Sequence[Covariance]) -> list[list[int]]:
    return alike([(c.shapes_mm.shape[1], c.ou is None) for c in covariances])


def _side_by_side(ones: Sequence[Linearised]) -> tuple[Array, list[NDArray[np.intp]]]:
    """Return residuals and slopes of explanations (u, m), each once, and which are whose."""
    place: dict[bytes, int] = {}
    columns: list[Array] = []
    known: dict[tuple[int, int], NDArray[np.intp]] = {}  # many differ in priors alone
    keys = [(id(one.residual_mm), id(one.slopes_mm)) for one in ones]
    for key, one in zip(keys, ones, strict=True):
        if key in known:
            continue
        own = []
        for column in (one.residual_mm, *one.slopes_mm.T):
            own.append(place.setdefault(column.tobytes(), len(place)))
            if own[-1] == len(columns):
                columns.append(column)
        known[key] = np.array(own)
    return np.column_stack(columns), [known[key] for key in keys]


def size_um(node: Node, name: str) -> float:
    """Return the root mean square of a part of the errors, µm; 0 where they have none."""
    return node.sizes_um.get(name, 0.0)


def samples_of(records: Sequence[Record]) -> Samples:
    """Return the samples of records, in their order."""
    counts = [len(r.curve) for r in records]
    geometries = list(dict.fromkeys(r.geometry for r in records))
    number = np.repeat(np.arange(len(records)), counts)
    return Samples(
        np.concatenate([r.curve.time_s - r.curve.time_s[0] for r in records]),
        np.concatenate([r.pressure_mbar for r in records]),
        np.concatenate([r.curve.deflection_mm for r in records]),
        np.concatenate([r.curve.phase for r in records]),
        number,
        np.repeat([r.placement for r in records], counts),
        np.repeat([geometries.index(r.geometry) for r in records], counts),
        np.concatenate([r.each(r.coarse**-0.5) for r in records]),
    )


@dataclass(frozen=True, eq=False)
class Measured:
    """A campaign's samples, and what is known of their errors whatever explains them.

    `noise_um` is that which was stated; `placement_scatter` as in a campaign.
    """

    records: Sequence[Record]
    noise_um: float | None = None
    placement_scatter: float | None = None

    @cached_property
    def samples(self) -> Samples:
        """The samples of all records, in their order."""
        return samples_of(self.records)

    @cached_property
    def softer_mm(self) -> Array:
        """What a softer place does (u,), mm per logarithm, as measured curves say."""
        return softer_mm(self.records)

    @cached_property
    def _columns_mm(self) -> Array:
        return columns_of(self.records)

    @cached_property
    def _look(self) -> Look:
        """What error models are shown beside a model that leaves nothing, and has no unknowns."""
        return Look(
            self.samples,
            np.concatenate([r.at_pressure_mm for r in self.records]),
            slopes_mm_per_mbar(self.records),
            np.zeros(len(self.samples)),
            np.zeros((len(self.samples), 0)),
            self.noise_um,
            np.concatenate([r.each(r.pressure_sd_mbar) for r in self.records]),
            pressure_errors_mm(self.records),
            self.placement_scatter,
        )

    def choose(
        self,
        linear: LinearModel,
        models: Sequence[ErrorModel],
        softer_mm: Array | None = None,
        before: ErrorChoice | None = None,
    ) -> ErrorChoice:
        """Return the errors of these kinds beside a model about its fit.

        `softer_mm` (u,) is what a placement's stiffness does, if not what measured curves say.
        """
        look = replace(
            self._look,
            deflection_mm=self._look.deflection_mm - linear.residual_mm,
            residual_mm=linear.residual_mm,
            slopes=linear.slopes_mm,
            softer_mm=self.softer_mm if softer_mm is None else softer_mm,
        )
        rest = (MESH_REST * self.samples.deflection_mm) ** 2
        return choose_errors(look, linear, self._columns_mm, rest, models, before)


def learn(
    measured: Measured,
    base: Linearised,
    thickness_mm: Array,
    before: CampaignErrors | None = None,
) -> CampaignErrors:
    """Return the errors as pure error sees them: repeats and roughness, whatever the model.

    `thickness_mm` (u,) are `thickness_slopes`; `before` are the errors about another fit.
    """
    models = models_of(measured.records, thickness_mm)
    pure = pure_error(measured, base, thickness_mm)
    found = measured.choose(pure, models, before=None if before is None else before.pure)
    return CampaignErrors((found,))


def look_at_errors(
    before: CampaignErrors,
    measured: Measured,
    one: Linearised,
    thickness_mm: Array,
    own_softer_mm: Array | None = None,
) -> ErrorChoice:
    """Return the errors as an explanation sees them, of the kinds that pure error may have.

    `own_softer_mm` (u,) is what a placement's stiffness does, if not what measured curves say.
    """
    best, pure = {part.name for part in before.pure.best.parts} | {"ou"}, before.pure
    models = [
        m for m in models_of(measured.records, thickness_mm)
        if m.name in best or pure.probability(m.name) > ERRORS.kind_kept
    ]  # fmt: skip
    return measured.choose(one.of_free, models, own_softer_mm, before.looks[-1])


def _sub(matrix: Array, kept: Mask) -> Array:
    return np.asarray(matrix[np.ix_(kept, kept)])


def pure_error(measured: Measured, base: Linearised, thickness_mm: Array) -> LinearModel:
    """Return the model as it is beside all that repeats may have in common, as good as free."""
    waves = smooth_columns(measured.records, ERRORS.smooth_degree, ERRORS.smooth_repeated)
    return _beside(base.of_free, waves, _common_columns(measured, thickness_mm))


def _beside(own: LinearModel, waves: Array, common: Array) -> LinearModel:
    """Return a model with polynomials (u, w) and `_common_columns` (u, m), mm, beside it."""
    precise = [(1e3 / ERRORS.smooth_sd_um) ** 2] * waves.shape[1]
    precise += [1.0 / ERRORS.common_sd**2] * common.shape[1]
    return LinearModel(
        own.residual_mm,
        np.hstack([own.slopes_mm, waves, common]),
        block_diag(own.precision, np.diag(precise)),
    )


def _common_columns(measured: Measured, thickness_mm: Array) -> Array:
    """Return what another stiffness and thickness of all repeats of a condition do (u, m).

    How large these errors are is told by what repeats differ by, not by what a model misses.
    """
    number = measured.samples.curve
    both = np.column_stack([measured.softer_mm, thickness_mm])
    repeated = [members for members in by_condition(measured.records) if len(members) > 1]
    each = [np.isin(number, members)[:, None] * both for members in repeated]
    return np.hstack([np.zeros((len(number), 0)), *each])


def smooth_columns(records: Sequence[Record], degree: int, more: int) -> Array:
    """Return what any model may leave (u, m), of mean square 1: columns of each condition.

    Polynomials in time of each phase; and in the suction over all phases, since a rig that is late
    brings its last part within a moment of a long hold. These, and so many degrees `more`, only
    where repeats tell of errors what they differ by: of one curve they would take up the errors
    too. So would those of each of several pulses, which have them where they were repeated.
    """
    starts = np.cumsum([0, *(len(r.curve) for r in records)])
    columns = []
    for members in by_condition(records):
        repeated = len(members) > 1
        each = {i: records[i].segment if repeated else records[i].curve.phase for i in members}
        own = degree + (more if repeated else 0)
        if repeated:
            columns.append(_along_suction(records, members, starts, own + ERRORS.smooth_more))
        for part in dict.fromkeys(x for i in members for x in each[i].tolist()):
            here = {i: np.flatnonzero(each[i] == part) for i in members}
            longest = max(len(samples) for samples in here.values())
            few = not repeated and longest <= own + 1
            count = 1 if few else min(own + 1, longest)
            block = np.zeros((starts[-1], count))
            for i, samples in here.items():
                if len(samples):
                    t = records[i].curve.time_s[samples]
                    x = (t - t[0]) / max(t[-1] - t[0], 1e-9)
                    block[starts[i] + samples] = legendre(x, count)
            columns.append(block)
    return np.hstack(columns)


def _placed_columns(records: Sequence[Record], degree: int, power: float = 1.0) -> Array:
    """Return polynomials (u, m) in a power of the suction of each repeat: what its place may do."""
    starts = np.cumsum([0, *(len(r.curve) for r in records)])
    number = np.repeat(np.arange(len(records)), np.diff(starts))
    repeated = [i for members in by_condition(records) if len(members) > 1 for i in members]
    each = [
        np.column_stack([number == i, _along_suction(records, [i], starts, degree, power)])
        for i in repeated
    ]
    return np.hstack([np.zeros((starts[-1], 0)), *each])


def _along_suction(
    records: Sequence[Record],
    members: Sequence[int],
    starts: NDArray[np.intp],
    degree: int,
    power: float = 1.0,
) -> Array:
    """Return polynomials (u, degree) in a power of p/p_max of some records, without a constant."""
    found = np.zeros((starts[-1], degree))
    top = max(1e-9, *(float(records[i].pressure_mbar.max()) for i in members))
    for i in members:
        x = np.clip(records[i].pressure_mbar / top, 0.0, 1.0) ** power
        found[starts[i] : starts[i + 1]] = legendre(x, degree + 1)[:, 1:]
    return found


def outliers(records: Sequence[Record], base: Linearised) -> Mask:
    """Return which samples (u,) do not belong to their curve, whatever the model."""
    samples = samples_of(records)
    step_mm = steps_of_samples_mm(samples)
    # Slopes of the model's curve: a glitch of the measured one would hide in its own slope.
    read_mm = np.concatenate([r.at_pressure_mm for r in records])
    model_mm = np.split(read_mm - base.residual_mm, samples.ends[:-1])
    known_mm = pressure_errors_mm(records, model_mm)
    # Without what placements have in common: that is of the measured curves, with their glitches.
    # And with fewer polynomials: they would follow the first samples, glitches of all repeats.
    waves = smooth_columns(records, ERRORS.smooth_degree, 0)

    def found(placed: Array) -> Mask:
        pure = _beside(base.of_free, np.hstack([waves, placed]), np.zeros((len(samples), 0)))
        # A first fit may be far off, as placements are: beside that no sample would be.
        pure = replace(pure, residual_mm=_rough_mm(pure.residual_mm, pure.slopes_mm))
        probability = outlier_probability(pure, samples, step_mm, known_mm)
        return np.asarray(probability > 0.5)

    placed = _placed_columns(records, ERRORS.placed_degree)
    bad = found(placed)
    longest, curves = ERRORS.glitch_longest, np.split(bad, samples.ends[:-1])
    if not any(np.convolve(one, np.ones(longest + 1)).max() > longest for one in curves):
        return bad
    # So long is no glitch, but a place: a thinner skin bends more, at the first few mbar alone.
    steep = _placed_columns(records, ERRORS.placed_degree, 0.5)
    return found(np.hstack([placed, steep]))


def _rough_mm(values_mm: Array, columns: Array) -> Array:
    """Return what columns (u, m) leave of values (u,), which single samples do not sway.

    Least squares with the weights of Cauchy's distribution (Holland and Welsch 1977, Commun. Stat.
    6:813).
    """
    weight = np.ones(len(values_mm))
    for _ in range(ERRORS.rough_rounds):
        found = np.linalg.lstsq(weight[:, None] * columns, weight * values_mm)[0]
        left = values_mm - columns @ found
        usual = max(float(np.median(np.abs(left))) / SPREAD, NOISE.least_mm)
        weight = 1.0 / np.sqrt(1.0 + np.square(left / (ERRORS.rough_tuning * usual)))
    return left
