"""The paper's stochastic algorithm (sections 2.4 and 2.5), as printed: `sto`.

N candidates are drawn from a box, uniformly or as a Latin hypercube; the N_b best span the next
box; it ends when the best error of an iteration differs from the one before by no more than C. The
boxes are those of the space's unit cube, which for the paper's space is the same up to scale. They
often shrink past the optimum along the flat valley of this problem, so the answer is near it, not
at it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from skinlab.errors import InputError
from skinlab.inference.methods.base import Method, Option
from skinlab.inference.problem import (
    MOST_SAMPLES,
    Estimate,
    Options,
    Problem,
    check,
)

CONFIDENCE = 0.99  # ρ, the paper's example
ACCURACY = 0.01  # e, likewise

Array = NDArray[np.float64]

SAMPLING = Option(
    "sampling", "uniform", "uniform, or a Latin hypercube", choices=("uniform", "lhs")
)
_ASKED = Option(
    "confidence",
    CONFIDENCE,
    "N from eq. (10), in place of --samples: how sure, 0 to 1",
    "more than 0 and less than 1",
    instead_of="samples",
)
_BEST_PART = Option(
    "accuracy",
    ACCURACY,
    "the same: in which best fraction of the box",
    "more than 0 and less than 1",
    instead_of="samples",
)


@dataclass(frozen=True, eq=False)
class Draw:
    """One iteration, in the coordinates of the unit cube."""

    low: Array  # (k,) the box that was drawn from
    high: Array
    candidates: Array  # (N, k)
    error_um: Array  # (N,) infinite where there is no model
    elite: NDArray[np.intp]  # the N_b best that there is a model for, in no order


def identify(
    problem: Problem,
    options: Options,
    rng: np.random.Generator,
    *,
    watch: Callable[[Draw], None] = lambda _: None,
) -> Estimate:
    """Return the best candidate of the last iteration; `watch` is told of every iteration.

    Raises:
        InputError: an option is out of its range.
    """
    check(options)
    sampling = SAMPLING.of(options)
    low, high = np.zeros(len(problem.space.names)), np.ones(len(problem.space.names))
    previous = least = np.inf
    last = 0.5 * (low + high)
    for iteration in range(1, options.most_iterations + 1):
        candidates = low + (high - low) * draw(rng, options.samples, len(low), sampling)
        error = problem.error_um(problem.space.from_unit(candidates))
        order = np.argpartition(error, options.best - 1)[: options.best]
        order = order[np.isfinite(error[order])]
        watch(Draw(low, high, candidates, error, order))
        if order.size and float(error[order].min()) < least:
            last, least = candidates[order[np.argmin(error[order])]], float(error[order].min())
        if order.size < 2:
            continue  # no box is spanned by less: draw again
        elite = candidates[order]
        best = int(order[np.argmin(error[order])])
        low, high = elite.min(axis=0), elite.max(axis=0)
        if abs(previous - error[best]) <= options.tolerance_um:
            return Estimate(
                problem.space.from_unit(candidates[best]),
                float(error[best]),
                iteration,
                iteration * options.samples,
                converged=True,
            )
        previous = float(error[best])
        last, least = candidates[best], previous
    return Estimate(
        problem.space.from_unit(last),
        least,
        options.most_iterations,
        options.most_iterations * options.samples,
        converged=False,
    )


def draw(rng: np.random.Generator, samples: int, dimensions: int, sampling: str) -> Array:
    """Return points (samples, dimensions) of the unit cube.

    In a Latin hypercube each of `samples` equal slices along each axis holds one point.
    """
    if sampling == "lhs":
        from scipy.stats.qmc import LatinHypercube  # slow to import, and seldom asked for

        return np.asarray(LatinHypercube(dimensions, rng=rng).random(samples))
    return rng.random((samples, dimensions))


def least_samples(confidence: float = CONFIDENCE, accuracy: float = ACCURACY) -> int:
    """Return the least N of eq. (10), N ≥ ln(1 − ρ) / ln(1 − e).

    With probability ρ one of N uniform draws then falls into the best fraction e of the box. That
    speaks of one draw and not of the sequence of shrinking boxes: for 38 of them, 0.99^38 = 0.68.

    Raises:
        InputError: ρ or e is not within 0…1.
    """
    for name, value in (("confidence", confidence), ("accuracy", accuracy)):
        if not 0.0 < value < 1.0:
            raise InputError(f"{name} {value:g}: expected more than 0 and less than 1")
    needed = math.log1p(-confidence) / math.log1p(-accuracy)
    if not needed <= MOST_SAMPLES:
        raise InputError(
            f"confidence {confidence:g} and accuracy {accuracy:g} ask for more than "
            f"{MOST_SAMPLES} samples, eq. (10)"
        )
    return math.ceil(needed)


def _by_eq_10(options: Options) -> bool:
    return bool({_ASKED.name, _BEST_PART.name} & set(dict(options.own)))


def _settle(options: Options) -> Options:
    """Return the options with N from eq. (10), where its confidence or accuracy are given."""
    if not _by_eq_10(options):
        return options
    samples = least_samples(_ASKED.of(options), _BEST_PART.of(options))
    rest = tuple((k, v) for k, v in options.own if k not in (_ASKED.name, _BEST_PART.name))
    return replace(options, samples=samples, own=rest)


def _remarks(options: Options) -> tuple[str, ...]:
    if _by_eq_10(options) or options.samples >= (least := least_samples()):
        return ()
    return (
        f"{options.samples} samples break the paper's rule, eq. (10): {least} or more for a "
        f"confidence of {CONFIDENCE:g} and an accuracy of {ACCURACY:g}",
    )


METHOD = Method(
    "sto",
    identify,
    "the paper's stochastic algorithm: random candidates from a box, the best of which span the "
    "next, smaller box, until the error stands still",
    (SAMPLING, _ASKED, _BEST_PART),
    in_papers_box=True,
    settle=_settle,
    remarks=_remarks,
)
