"""A population as prior: what is known of skins like this one before its curve is measured.

`skinlab study` learns it and writes study.toml. It is a Student distribution in coordinates in
which the curves' own prior is flat: logarithms of stiffnesses, and ν. A curve is first identified
by itself; its draws are then weighted by the population's density, which is exact, and fresh draws
are added where too few of them are left. A curve that says clearly that its skin is unlike the
population is not pulled towards it: it keeps its own intervals and gets the flag `unlike_cohort`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from drivers.reading import read_whole
from skinlab.curves.curve import Curve
from skinlab.errors import InputError
from skinlab.inference.identify import Identifier, from_draws
from skinlab.inference.posterior import Draws
from skinlab.inference.result import Identification
from skinlab.inference.settings import POPULATION
from skinlab.inference.uncertainty import Uncertainty
from skinlab.io.documents import decode, of_schema, read_toml, text_of
from skinlab.io.files import named_in_errors
from skinlab.mechanics.names import is_logarithmic

Array = NDArray[np.float64]

SCHEMA = "skinlab.prior/1"
UNLIKE = "unlike_cohort"

_ROUND_SEED = 7919


class Site(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a site's mean differs by, and how many curves say so."""

    shift: list[float]
    curves: int


class PriorFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A whole study.toml. Vectors are in the order of `parameters`, in their `coordinates`."""

    schema: str
    parameters: list[str]
    coordinates: list[str]
    mean: list[float]
    covariance: list[list[float]]
    freedom: Annotated[float, Meta(gt=2)]
    people: int
    curves: int
    model_hash: str
    sites: dict[str, Site] = msgspec.field(default_factory=dict)
    age_years: float | None = None  # at which `mean` holds
    age_sd_years: float = 0.0
    per_decade: list[float] = msgspec.field(default_factory=list)
    source: str = ""

    def __post_init__(self) -> None:
        """Refuse what is no distribution."""
        k = len(self.parameters)
        if self.schema != SCHEMA:
            raise ValueError(f"schema: {self.schema!r}, expected {SCHEMA!r}")
        lengths = [len(self.coordinates), len(self.mean), len(self.covariance)]
        lengths += [len(row) for row in self.covariance]
        lengths += [len(site.shift) for site in self.sites.values()]
        if not k or any(n != k for n in lengths) or len(self.per_decade) not in (0, k):
            raise ValueError(f"expected {k} numbers in each vector, one a parameter")
        if any(c not in ("log", "linear") for c in self.coordinates):
            raise ValueError("coordinates: expected log or linear")
        matrix = np.array(self.covariance)
        if not (np.isfinite(matrix).all() and np.isfinite(self.mean).all()):
            raise ValueError("a number is not finite")
        if not np.allclose(matrix, matrix.T) or np.linalg.eigvalsh(matrix).min() <= 0:
            raise ValueError("covariance: expected a symmetric, positive definite matrix")


def coordinates_of(names: Sequence[str]) -> list[str]:
    """Return in which coordinate each parameter's own prior is flat, and people scatter evenly."""
    return ["log" if is_logarithmic(name) else "linear" for name in names]


def to_coordinates(parameters: Array, coordinates: Sequence[str]) -> Array:
    """Return parameters (..., k) in their coordinates."""
    logs = np.array([c == "log" for c in coordinates])
    return np.where(logs, np.log(np.where(logs, parameters, 1.0)), parameters)


@dataclass(frozen=True)
class Prior:
    """A population, for one person as far as known: at a site, of an age."""

    file: PriorFile
    text: str
    site: str | None = None
    age_years: float | None = None

    def __post_init__(self) -> None:
        """Refuse a site that the population does not have.

        Raises:
            InputError: so.
        """
        if self.site is not None and self.file.sites and self.site not in self.file.sites:
            known = ", ".join(sorted(self.file.sites))
            raise InputError(f"the prior has no site {self.site!r}; expected one of: {known}")
        if self.age_years is not None and not 0 <= self.age_years <= 130:
            raise InputError(f"age_years {self.age_years:g}: expected 0 to 130")

    def to_json(self) -> dict[str, Any]:
        """Return all that a replay must know of it."""
        return {"toml": self.text, "site": self.site, "age_years": self.age_years}

    def moments(self) -> tuple[Array, Array]:
        """Return mean (k,) and scale matrix (k, k): of all sites and ages where not stated."""
        mean, scale = np.array(self.file.mean), np.array(self.file.covariance)
        sites = self.file.sites
        if sites:
            shifts = np.array([s.shift for s in sites.values()])
            if self.site is not None:
                mean = mean + sites[self.site].shift
            else:
                weight = np.array([float(s.curves) for s in sites.values()])
                weight /= weight.sum()
                middle = weight @ shifts
                mean = mean + middle
                scale = scale + (weight[:, None] * (shifts - middle)).T @ (shifts - middle)
        if self.file.per_decade and self.file.age_years is not None:
            slope = np.array(self.file.per_decade)
            if self.age_years is not None:
                mean = mean + slope * (self.age_years - self.file.age_years) / 10.0
            else:
                scale = scale + np.outer(slope, slope) * (self.file.age_sd_years / 10.0) ** 2
        return mean, scale

    def distance(self, parameters: Array) -> Array:
        """Return the squared distance (n,) of parameters (n, k), in the population's deviations."""
        mean, scale = self.moments()
        z = to_coordinates(parameters, self.file.coordinates) - mean
        return np.asarray(np.einsum("ni,ij,nj->n", z, np.linalg.inv(scale), z))

    def log_density(self, parameters: Array) -> Array:
        """Return the logarithm of the density (n,), up to a constant."""
        k, freedom = len(self.file.mean), self.file.freedom
        return np.asarray(-0.5 * (freedom + k) * np.log1p(self.distance(parameters) / freedom))

    @property
    def far(self) -> float:
        """The squared distance that one of a hundred people of the population exceeds."""
        k = len(self.file.mean)
        from scipy.stats import f as f_distribution  # slow to import

        return k * float(f_distribution.ppf(POPULATION.rare, k, self.file.freedom))


def read_prior(path: Path, site: str | None = None, age_years: float | None = None) -> Prior:
    """Return the population of a study.toml.

    Raises:
        InputError: it cannot be read, a field is wrong, or it has no such site.
    """
    with named_in_errors(path):
        text = text_of(read_whole(path))
    return decode_prior(text, str(path), site, age_years)


def decode_prior(
    text: str, where: str, site: str | None = None, age_years: float | None = None
) -> Prior:
    """Return the population of this text, which is that of `where`.

    Raises:
        InputError: as `read_prior`.
    """
    with named_in_errors(where):
        file = decode(of_schema(read_toml(text), SCHEMA), PriorFile)
        return Prior(file, text, site, age_years)


@dataclass(frozen=True)
class PopulationIdentifier(Identifier):
    """Identifies curves by themselves, then with a population as prior.

    `population` None: by themselves alone.
    """

    population: Prior | None = field(default=None)

    def __call__(self, curve: Curve) -> Identification:
        """Return the answer, as `Identifier` does."""
        return self._narrowed(lambda one: Identifier.__call__(one, curve))

    def joint(self, curves: Sequence[Curve]) -> Identification:
        """Return one answer for several curves of one skin, as `Identifier` does."""
        return self._narrowed(lambda one: Identifier.joint(one, curves))

    def _narrowed(self, identify: Callable[[Identifier], Identification]) -> Identification:
        alone = identify(self)
        prior, left = self.population, alone.uncertainty
        if prior is None or left is None or not alone.parameters:
            return alone
        names = list(alone.parameters)
        _check(prior, self, names)
        k = len(names)
        order = np.argsort(prior.distance(left.draws.parameters[:, :k]))
        near = order[np.searchsorted(np.cumsum(left.draws.weight[order]), POPULATION.nearest)]
        if prior.distance(left.draws.parameters[near, :k][None])[0] > prior.far:
            return replace(alone, flags=(*alone.flags, UNLIKE))
        rounds = [left]
        while True:
            draws = _weighted(rounds, prior, k)
            if draws.effective >= POPULATION.enough or len(rounds) >= POPULATION.most_rounds:
                break
            again = identify(replace(self, seed=self.seed + _ROUND_SEED * len(rounds)))
            assert again.uncertainty is not None
            rounds.append(again.uncertainty)
        # The optimum at a bound is no longer the value, and what was not fixed may be now.
        flags = [f for f in alone.flags if not f.startswith(("at_bound:", "not_identifiable:"))]
        return from_draws(
            replace(
                alone,
                flags=tuple(flags),
                evaluations=alone.evaluations + draws.evaluations - left.draws.evaluations,
                uncertainty=replace(left, draws=draws),
            ),
            left.space,
            draws,
            self.database.law,
            self.kappa,
            self.seed,
        )


def _check(prior: Prior, identifier: Identifier, names: list[str]) -> None:
    if names != prior.file.parameters:
        raise InputError(
            f"the prior is of {', '.join(prior.file.parameters)}; this model has {', '.join(names)}"
        )
    own = identifier.provenance().model_hash
    if prior.file.model_hash != own:
        raise InputError(
            f"the prior was learned with another model, {prior.file.model_hash[:19]}…; here it is "
            f"{own[:19]}…: numbers of different laws cannot be compared"
        )


def _weighted(rounds: Sequence[Uncertainty], prior: Prior, k: int) -> Draws:
    """Return the draws of all rounds, weighted by the population's density of the first k."""
    every = [one.draws for one in rounds]
    parameters = np.concatenate([d.parameters for d in every])
    density = prior.log_density(parameters[:, :k])
    weight = np.concatenate([d.weight for d in every]) * np.exp(density - density.max())
    # Each round counts from its own best fit, which is the same to within its draws.
    target = np.concatenate([d.log_target - d.log_target.max() for d in every])
    return Draws(
        np.concatenate([d.unit for d in every]),
        parameters,
        weight / weight.sum(),
        target + density,
        sum(d.evaluations for d in every),
    )


def with_prior(identifier: Identifier, prior: Prior) -> PopulationIdentifier:
    """Return the identifier with a population as prior.

    Raises:
        InputError: the method gives no intervals, or the prior is of another model.
    """
    if identifier.method != "auto":
        raise InputError("a prior needs the intervals that only the method auto gives")
    given = {f.name: getattr(identifier, f.name) for f in fields(identifier)}
    return PopulationIdentifier(**given | {"population": prior})
