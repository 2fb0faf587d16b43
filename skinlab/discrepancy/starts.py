"""What a model leaves to be found, and where fits of it begin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from skinlab.discrepancy.records import Record
from skinlab.discrepancy.unknowns import BasePrior, Known, Unknowns
from skinlab.mechanics.effects import get_effect
from skinlab.mechanics.model_file import Model, Normal

Array = NDArray[np.float64]

THICKNESS = "thickness_error"  # the effect that the stated uncertainty of the thickness is about
# Shares of the law's ranges from which the base model is fitted: of the scale, of other logarithms,
# of what is none; and the middle, from which it is fitted with effects.
_SCALES = (0.375803649418, 0.563705474127, 0.783536516671)
_RATIOS, _VALUES = (0.538508052478, 0.749009372356), (0.275862068966, 0.758620689655)
_MIDDLE = (0.563705474127, 0.617446047432, 0.448275862069)


def unknowns_of(model: Model) -> Unknowns:
    """Return the unknowns of a model, with what it says of its effects as their priors."""
    known, space = [], model.space
    for name, ranges in model.effects.items():
        for parameter, at in ranges.items():
            normal = at.prior if isinstance(at.prior, Normal) else None
            sd, mean = (0.0, None) if normal is None else (normal.sd, normal.mean)
            low, high = _own_bounds(model, name, parameter)
            known.append(Known(name, parameter, at.value, sd, mean=mean, low=low, high=high))
    priors = tuple(BasePrior(*known) for known in model.normal_priors(space))
    return Unknowns(
        tuple(sorted(model.effects)), model.model.kappa, tuple(known), model.model.law,
        space if model.parameters else None, priors,
    )  # fmt: skip


def _own_bounds(model: Model, effect: str, parameter: str) -> tuple[float | None, float | None]:
    """Return a model's bounds of an effect's parameter; None where they are the effect's own."""
    low, high = model.bounds(f"{effect}.{parameter}")
    own = next(p for p in get_effect(effect).parameters if p.name == parameter)
    return (None if low == own.low else low), (None if high == own.high else high)


def _kinds(unknowns: Unknowns) -> list[int]:
    """Return of each of the law's parameters: the scale 0, other logarithms 1, what is none 2."""
    space = unknowns.space
    return [
        0 if i == space.scale else 1 if transform != "linear" else 2
        for i, transform in enumerate(space.transforms)
    ]


def starts(unknowns: Unknowns) -> list[Array]:
    """Return coordinates of the law's parameters to begin from."""
    shares = [(_SCALES, _RATIOS, _VALUES)[kind] for kind in _kinds(unknowns)]
    every = [unknowns.at_share(np.array(share)) for share in product(*shares)]
    # Far from one another first: their number has no factor but two and three.
    return [every[5 * i % len(every)] for i in range(len(every))]


def middle_of(unknowns: Unknowns) -> Array:
    """Return coordinates of the law's parameters in the middle of where those of skins are."""
    return unknowns.at_share(np.array([_MIDDLE[kind] for kind in _kinds(unknowns)]))


def with_thickness(unknowns: Unknowns, records: Sequence[Record]) -> Unknowns:
    """Return the unknowns with the thickness among them, where it is stated with an uncertainty.

    One skin has one thickness: its relative error is common to all curves.
    """
    sd = max((r.thickness_sd_mm / r.geometry.thickness_mm for r in records), default=0.0)
    if sd <= 0.0 or THICKNESS in unknowns.effects:
        return unknowns
    known = Known(THICKNESS, "ratio", 1.0, sd, stated=True)
    return replace(
        unknowns,
        effects=tuple(sorted((*unknowns.effects, THICKNESS))),
        known=(*unknowns.known, known),
    )
