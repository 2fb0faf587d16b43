"""The flags of an answer: one catalogue of their names and words, and one set of rules.

A flag may carry what it is about behind a colon: a parameter's name, or a number.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.curve import Curve
from skinlab.curves.heights import heights_of
from skinlab.inference.settings import JUDGEMENT

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Flag:
    """`label` in a few words, `meaning` and `advice` a sentence each; {} is what it is about."""

    label: str
    meaning: str
    advice: str


CATALOGUE = {
    "at_bound": Flag(
        "{} at the edge of its range",
        "The best fit has {} at the end of the searched range: the true value may lie beyond.",
        "Check opening and thickness, and do not trust the number.",
    ),
    "not_identifiable": Flag(
        "{} is not determined by this curve",
        "This curve does not determine {} well: its interval covers most of what is possible. Do "
        "not use the number.",
        "Measure with another opening or a higher pressure as well (“skinlab identify --advise” "
        "says which).",
    ),
    "learned_from_these": Flag(
        "the model was learned from these curves",
        "The model's effects were learned from these very curves: what the model says of their "
        "size is left aside here, so that the curves count once.",
        "Nothing is wrong; on other curves the model's knowledge narrows the intervals.",
    ),
    "misfit_above_noise": Flag(
        "misfit above the noise",
        "The residual is clearly more than noise: the model misses something here, and the "
        "intervals mean less.",
        "Repeat the measurement, look for contact, tape and movement; “skinlab discrepancy” looks "
        "for the effect.",
    ),
    "correlated_noise": Flag(
        "errors that last",
        "Errors of neighbouring samples go together, as those of tremor and breathing do: more "
        "samples add less than their number suggests, and the intervals account for it.",
        "Nothing is wrong by itself; a calmer measurement narrows the intervals.",
    ),
    "stated_noise_contradicted": Flag(
        "another noise than stated",
        "The residuals show another noise than the one that was stated; intervals, where there are "
        "any, follow the residuals.",
        "Check the statement; if it is right, look for movement and contact.",
    ),
    "stated_pressure_noise_contradicted": Flag(
        "pressure noise {} mbar, not as stated",
        "The pressure channel shows a noise of {} mbar, and another one was stated; the intervals "
        "follow the statement.",
        "Check the statement, or leave it out: then the channel's own noise is used.",
    ),
    "outliers": Flag(
        "samples left out: {}",
        "Samples that do not belong to the curve were left out: {}.",
        "Look where they are; if there are many, hold the probe still and measure again.",
    ),
    "crease": Flag(
        "creases",
        "The surface creases at the opening's edge; the intervals account for that.",
        "Compare such a curve with care, or measure with less suction.",
    ),
    "fitted_to": Flag(
        "fitted to {} mbar only",
        "Only the samples up to {} mbar were fitted: beyond, the surface creases at the opening's "
        "edge, and no model of it is to be trusted.",
        "Use the intervals as they are; measure with less suction or a smaller opening.",
    ),
    "thinned": Flag(
        "one in {} samples fitted",
        "The curve is very long: one in {} of its samples was fitted, which shows nearly as much.",
        "Nothing is wrong; a lower rate measures as well.",
    ),
    "outside_database": Flag(
        "partly outside the database",
        "Samples, the whole curve, or thicknesses within the stated deviation lie where nothing "
        "was computed, and were left out.",
        "Use a thickness and a pressure inside the database; a smaller opening takes thinner skin.",
    ),
    "not_converged": Flag(
        "not converged",
        "The search did not end by itself: the values are where it was stopped.",
        "Identify again with other options, or measure again.",
    ),
    "unlike_cohort": Flag(
        "unlike the population",
        "This skin is unlike the population that was given as prior, so the prior was not used.",
        "Check subject, site, opening and thickness; if they are right, use the numbers as they "
        "are.",
    ),
    "unlike_model": Flag(
        "unlike the model's {}",
        "These curves contradict what the model says of the size of {}, so that was not used.",
        "Check subject and site; if they are right, the effect has another size here: use the "
        "numbers as they are.",
    ),
    "height_not_reached": Flag(
        "height not reached",
        "A height that the program was to stop at was not reached within its pressure.",
        "Use a program with more pressure, or check the contact.",
    ),
    "partial_curve": Flag(
        "cut short",
        "The curve was cut short, and only what there is was fitted.",
        "Measure again.",
    ),
    "not_first_cycle": Flag(
        "not the first loading",
        "The site was loaded before: skin is softer from the second loading on, and the elastic "
        "law describes the first.",
        "Compare it with later loadings only.",
    ),
}


def of_curves(curves: Sequence[Curve], left_out: Sequence[int]) -> list[str]:
    """Return what there is to say of the curves; `left_out` are samples beyond the database."""
    flags = []
    if any(left_out):
        flags.append("outside_database")
    if any(c.setup.cycle != 1 for c in curves):
        flags.append("not_first_cycle")
    if any(not height.reached for c in curves for height in heights_of(c)):
        flags.append("height_not_reached")
    if any(c.partial for c in curves):
        flags.append("partial_curve")
    return flags


def of_optimum(names: Sequence[str], unit: Array, *, converged: bool) -> list[str]:
    """Return what there is to say of an optimum (k,) in its space's unit cube."""
    flags = [
        f"at_bound:{name}"
        for name, at in zip(names, unit, strict=False)
        if min(at, 1.0 - at) <= JUDGEMENT.at_bound
    ]
    return flags if converged else [*flags, "not_converged"]
