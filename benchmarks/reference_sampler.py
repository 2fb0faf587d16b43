"""The posterior beside a reference sampler: emcee over the skin's and the errors' parameters.

    OPENBLAS_NUM_THREADS=1 python benchmarks/identification.py sampler [--curves 50]
        [--seed 20290401]

Curves are those of the row ou_0.3s of coverage.py. Both sides have white errors and errors that
last, with the same priors; skinlab integrates the errors' parameters by a quadrature over a
linearised model, emcee (Foreman-Mackey et al. 2013, PASP 125:306) walks over all six unknowns of
the model as it is. Where skinlab's quantile q of a marginal is, emcee has a share of its draws
below; that less q, by the Monte Carlo errors of both, is z.

A walk by differences of walkers alone (ter Braak and Vrugt 2008) remembers some 200 steps along
these valleys. Half of the proposals here do not depend on where a walker is: they are Student
distributions along skinlab's posterior. The walk's target is the same whatever is proposed.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import emcee
import numpy as np
from coverage import NAMES, ROWS, measured
from numpy.typing import NDArray
from prior_skins import Skin, skins

from skinlab.inference.covariance import Covariance, OrnsteinUhlenbeck, products
from skinlab.inference.error_choice import ErrorChoice
from skinlab.inference.error_models.base import ErrorModel, Look, Part
from skinlab.inference.error_models.ornstein_uhlenbeck import ERROR_MODEL as OU
from skinlab.inference.error_models.white import ERROR_MODEL as WHITE
from skinlab.inference.identify import Identifier
from skinlab.inference.optimise import polish
from skinlab.inference.posterior import Draws
from skinlab.inference.problem import SquaredMisfit
from skinlab.inference.samples import choose, group
from skinlab.inference.uncertainty import Sensor, about, assess
from skinlab.parameters import Space
from skinlab.tables.store import shipped_table

Array = NDArray[np.float64]

SHARES = (0.05, 0.25, 0.5, 0.75, 0.95)
WALKERS, STEPS, FIRST = 32, 2000, 200  # 50 times as long as the walk remembers
CENTRES, FREEDOM, WIDER, STRIDE = 200, 5.0, 1.2, 0.3  # of the proposals
NO_SENSOR = Sensor(None, 0.0)


@dataclass(frozen=True)
class Always:
    """An error model that is always there."""

    model: ErrorModel

    def __getattr__(self, name: str) -> Any:
        """Return what the model has."""
        return getattr(self.model, name)

    def part(self, look: Look) -> Part | None:
        """Return its part, as one that always is there."""
        part = self.model.part(look)
        return None if part is None else replace(part, always=True, log_odds=0.0)


class Independent:
    """Proposals from Student distributions about centres (m, d) with roots (m, d, d) of scales."""

    def __init__(self, centres: Array, roots: Array) -> None:
        """Prepare."""
        self._centres, self._roots = centres, roots
        self._inverse = np.linalg.inv(roots)
        self._log_det = np.log(np.abs(np.linalg.det(roots)))

    def log_density(self, at: Array) -> Array:
        """Return the log density (n,) at points (n, d), up to a constant."""
        off = at[:, None, :] - self._centres
        square = np.square(np.einsum("mij,nmj->nmi", self._inverse, off)).sum(axis=2)
        power = -0.5 * (FREEDOM + at.shape[1])
        each = power * np.log1p(square / FREEDOM) - self._log_det
        return np.asarray(np.logaddexp.reduce(each, axis=1))

    def __call__(self, at: Array, random: np.random.RandomState) -> tuple[Array, Array]:
        """Return new points (n, d), and the logarithms (n,) of the odds of coming back."""
        which = random.randint(len(self._centres), size=len(at))
        z = random.standard_normal(at.shape)
        z *= np.sqrt(FREEDOM / random.chisquare(FREEDOM, len(at)))[:, None]
        new = self._centres[which] + np.einsum("nij,nj->ni", self._roots[which], z)
        return new, self.log_density(at) - self.log_density(new)


def proposals(
    space: Space, misfit: SquaredMisfit, ours: Draws, choice: ErrorChoice, rng: np.random.Generator
) -> Independent:
    """Return proposals along our posterior, errors' parameters about our nodes."""
    k = ours.unit.shape[1]
    mine = [i for i, node in enumerate(choice.nodes) if node.combination is choice.best]
    values = np.array([choice.nodes[i].log_values for i in mine])
    weight = choice.weight[mine] / choice.weight[mine].sum()
    mean = weight @ values
    spread = (values - mean).T @ ((values - mean) * weight[:, None])
    centres = ours.unit[rng.choice(len(ours.weight), CENTRES, p=ours.weight)]
    stride = STRIDE * np.sqrt(ours.weight @ np.square(ours.unit - ours.weight @ ours.unit))
    precision = polish(space, misfit, centres, most_iterations=0).normal + np.diag(stride**-2.0)
    roots = np.zeros((CENTRES, k + len(mean), k + len(mean)))
    roots[:, :k, :k] = WIDER * np.linalg.cholesky(np.linalg.inv(precision))
    roots[:, k:, k:] = WIDER * np.linalg.cholesky(spread + 1e-4 * np.eye(len(mean)))
    return Independent(np.hstack([centres, np.tile(mean, (CENTRES, 1))]), roots)


def one(skin: Skin, seed: int) -> dict[str, Any]:
    """Return by how much the two differ on one curve."""
    row = ROWS["ou_0.3s"]
    curve = measured(
        row.errors, skin, row.rate_hz, np.random.default_rng([seed, skin.number])
    ).curve
    table = shipped_table()
    groups = group([choose(curve, ("load",), table)])
    models = [g.model(table, "paper") for g in groups]
    space = models[0].space
    optimum = Identifier(table, sensor=NO_SENSOR)(curve).optimum or {}
    starts = space.to_unit(np.array([optimum[n] for n in NAMES]))[None]
    offered: Sequence[Any] = (WHITE, Always(OU))
    rng = np.random.default_rng([seed, skin.number, 1])
    ours = assess(
        table, "paper", groups, models, space, starts, NO_SENSOR, rng, error_models=offered
    ).draws
    fitted = about(groups, models, space, starts[0], NO_SENSOR)
    choice = fitted.choose_errors(np.ones(len(fitted.samples), dtype=bool), error_models=offered)
    each = [p for part in choice.best.parts for p in part.parameters]
    white = next(p for p in choice.best.parts if p.name == "white")
    plain, columns = choice.best.fixed_mm2, choice.mode.columns_mm
    measured_mm, time_s = fitted.samples.deflection_mm, fitted.samples.time_s

    def log_density(at: Array) -> Array:
        """Return the log densities (n,) of skins and errors' parameters (n, 3 + errors)."""
        found = np.full(len(at), -np.inf)
        inside = ((at[:, :3] >= 0.0) & (at[:, :3] <= 1.0)).all(axis=1)
        model_mm = models[0].deflection_mm(space.from_unit(np.clip(at[:, :3], 0.0, 1.0)))
        live = np.flatnonzero(inside & np.isfinite(model_mm).all(axis=1))
        if not len(live):
            return found
        covariances = []
        for i in live:
            value = dict(zip([p.name for p in each], np.exp(at[i, 3:]).tolist(), strict=True))
            variance = plain + white.terms([value["white_um"]]).variance_mm2
            process = OrnsteinUhlenbeck(1e-3 * value["ou_um"], value["ou_s"])
            covariances.append(Covariance(variance, columns, (len(time_s),), process, time_s))
        squares, log_determinant = products(covariances, (measured_mm - model_mm[live]).T)
        prior = [sum(p.log_prior(v) for p, v in zip(each, at[i, 3:], strict=True)) for i in live]
        found[live] = prior - 0.5 * (np.einsum("nii->ni", squares).diagonal() + log_determinant)
        return found

    nodes = rng.choice(len(choice.nodes), WALKERS, p=choice.weight)
    first = rng.choice(len(ours.weight), WALKERS, p=ours.weight)
    begin = np.column_stack(
        [
            np.clip(ours.unit[first] + 1e-3 * rng.standard_normal((WALKERS, 3)), 1e-6, 1 - 1e-6),
            np.array([choice.nodes[i].log_values for i in nodes])
            + 1e-2 * rng.standard_normal((WALKERS, len(each))),
        ]
    )
    misfit = models[0].misfit(measured_mm, choice.mode)
    own = emcee.moves.MHMove(proposals(space, misfit, ours, choice, rng))
    moves = [(own, 0.5), (emcee.moves.DEMove(), 0.4), (emcee.moves.DESnookerMove(), 0.1)]
    sampler = emcee.EnsembleSampler(
        WALKERS, begin.shape[1], log_density, moves=moves, vectorize=True
    )
    sampler.random_state = np.random.RandomState(seed + skin.number).get_state()
    sampler.run_mcmc(begin, STEPS + FIRST)
    chain = sampler.get_chain(discard=FIRST)
    length = emcee.autocorr.integrated_time(chain, quiet=True)[:3]
    walked = space.from_unit(chain.reshape(-1, chain.shape[-1])[:, :3])
    found: dict[str, Any] = {"skin": skin.number, "effective": {}, "off": {}, "z": {}}
    for i, name in enumerate(NAMES):
        order = np.argsort(ours.parameters[:, i])
        below = np.cumsum(ours.weight[order])
        values = np.interp(SHARES, below, ours.parameters[order, i])
        off = [float((walked[:, i] < v).mean() - q) for v, q in zip(values, SHARES, strict=True)]
        effective = WALKERS * STEPS / float(length[i])
        error = [np.sqrt(q * (1 - q) * (1 / effective + 1 / ours.effective)) for q in SHARES]
        found["effective"][name] = round(effective)
        found["off"][name] = np.round(off, 4).tolist()
        found["z"][name] = np.round(np.array(off) / error, 2).tolist()
    return found


def sampler(curves: int, seed: int) -> dict[str, Any]:
    """Return how the quantiles of both agree."""
    found = []
    for skin in skins(curves, seed=seed):
        found.append(one(skin, seed))
        print(json.dumps(found[-1]), file=sys.stderr, flush=True)
    z = np.array([[f["z"][n] for n in NAMES] for f in found])
    off = np.array([[f["off"][n] for n in NAMES] for f in found])
    return {
        "curves": curves,
        "shares": SHARES,
        "mean_off": off.mean(axis=0).round(4).tolist(),
        "root_mean_square_off": np.sqrt((off**2).mean(axis=0)).round(4).tolist(),
        "root_mean_square_z": np.sqrt((z**2).mean(axis=0)).round(2).tolist(),
        "each": found,
    }
