"""Error models, one a file, found by looking: every module here that defines ERROR_MODEL."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from skinlab.plugins import Registry, needs, warn

if TYPE_CHECKING:
    from skinlab.inference.error_models.base import ErrorModel, Look, Part, Terms


def check_error_model(one: object) -> None:
    """Check that an extension is an error model.

    Raises:
        TypeError: it is not.
    """
    needs(one, "meaning", "prior", "part")


ERROR_MODELS: Registry[ErrorModel] = Registry(
    "error model", __name__, "ERROR_MODEL", "skinlab.error_models", check_error_model
)


def part_of(model: ErrorModel, look: Look) -> Part | None:
    """Return a model's part for these samples; an installed one that breaks down has none.

    It is told of once, and everything else goes on.
    """
    who = ERROR_MODELS.who(model.name)
    if who is None:
        return model.part(look)
    from skinlab.inference.error_models.base import Part

    try:
        part: object = model.part(look)
        if part is None:
            return None
        if not isinstance(part, Part):
            raise TypeError(f"it returned a {type(part).__name__}; expected a Part or None")
        _check_part(part, len(look.samples))
    except Exception as error:  # noqa: BLE001 -- no plugin may end what others can answer
        warn(f"{who}: broke down, and is left out: {type(error).__name__}: {error}")
        return None
    return replace(part, terms=_named(model.name, part.terms))


def _check_part(part: Part, count: int) -> None:
    """Check a part of so many samples: its prior, and its terms there.

    Raises:
        TypeError: one is not what it has to be.
    """
    import numpy as np  # slow to import

    if not math.isfinite(part.log_odds):
        raise TypeError(f"log_odds is {part.log_odds}; expected a number")
    for one in part.parameters:
        if not (math.isfinite(one.median) and one.median > 0.0 and one.log_sd > 0.0):
            raise TypeError(
                f"the prior of {one.name} is none: expected a median and a width above 0"
            )
    terms = part.terms([one.median for one in part.parameters])
    wide = () if terms.columns_mm is None else np.shape(terms.columns_mm)[1:2] or (0,)
    wanted = {
        "variance_mm2": (terms.variance_mm2, ((), (count,))),
        "stretch": (terms.stretch, ((count,),)),
        "columns_mm": (terms.columns_mm, ((count, *wide),)),
        "bound": (part.bound, ((), (count,))),
    }
    for name, (value, shapes) in wanted.items():
        if value is None:
            continue
        if np.shape(value) not in shapes:
            raise TypeError(f"{name} has the shape {np.shape(value)}; expected {shapes[-1]}")
        if not np.isfinite(value).all():
            raise TypeError(f"{name} is not finite")


def _named(name: str, terms: Callable[[Sequence[float]], Terms]) -> Callable[..., Terms]:
    """Return the terms, whose errors name the model."""

    def named(values: Sequence[float]) -> Terms:
        with ERROR_MODELS.at_work(name):
            return terms(values)

    return named
