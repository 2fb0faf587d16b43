"""Error models, one a file, found by looking: every module here that defines ERROR_MODEL."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from skinlab.plugins import Registry, needs, texts, warn

_HUGE = 1e9  # mm²: squares overflow far above

if TYPE_CHECKING:
    from skinlab.inference.error_models.base import ErrorModel, Look, Part, Terms


def check_error_model(one: object) -> None:
    """Check that an extension is an error model.

    Raises:
        TypeError: it is not.
    """
    needs(one, "meaning", "prior", "part")
    texts(one, "meaning", "prior")
    if not callable(one.part):  # type: ignore[attr-defined]
        raise TypeError("its part is no function of a Look")


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
    except (Exception, SystemExit) as error:  # noqa: BLE001 -- no plugin may end others' answers
        warn(f"{who}: broke down, and is left out: {type(error).__name__}: {error}")
        return None
    return replace(part, terms=_named(model.name, part.terms, len(look.samples)))


def _check_part(part: Part, count: int) -> None:
    """Check a part of so many samples: its prior, and its terms there.

    Raises:
        TypeError: one is not what it has to be.
    """
    texts(part, "name", "why")
    if not math.isfinite(part.log_odds):
        raise TypeError(f"log_odds is {part.log_odds}; expected a number")
    for one in part.parameters:
        if not (math.isfinite(one.median) and one.median > 0.0 and one.log_sd > 0.0):
            raise TypeError(
                f"the prior of {one.name} is none: expected a median and a width above 0"
            )
    _check_terms(part.terms([one.median for one in part.parameters]), count)
    _check_numbers("bound", part.bound, ((), (count,)))


def _check_terms(terms: object, count: int) -> None:
    """Check what a part adds to the errors of so many samples.

    Raises:
        TypeError: it is none.
    """
    import numpy as np  # slow to import

    from skinlab.inference.error_models.base import Terms as Found

    if not isinstance(terms, Found):
        raise TypeError(f"terms returned a {type(terms).__name__}; expected Terms")
    wide = () if terms.columns_mm is None else np.shape(terms.columns_mm)[1:2] or (0,)
    wanted = {
        "variance_mm2": (terms.variance_mm2, ((), (count,))),
        "stretch": (terms.stretch, ((count,),)),
        "columns_mm": (terms.columns_mm, ((count, *wide),)),
    }
    for name, (value, shapes) in wanted.items():
        _check_numbers(name, value, shapes)
    if np.min(terms.variance_mm2, initial=0.0) < 0.0:
        raise TypeError("variance_mm2 is below 0")


def _check_numbers(name: str, value: Any, shapes: Sequence[tuple[int, ...]]) -> None:
    import numpy as np

    if value is None:
        return
    if np.shape(value) not in shapes:
        raise TypeError(f"{name} has the shape {np.shape(value)}; expected {shapes[-1]}")
    if not np.isfinite(value).all():
        raise TypeError(f"{name} is not finite")
    if np.max(np.abs(value), initial=0.0) > _HUGE:
        raise TypeError(f"{name} is beyond {_HUGE:g}")


def _named(
    name: str, terms: Callable[[Sequence[float]], Terms], count: int
) -> Callable[..., Terms]:
    """Return the terms for so many samples, whose errors name the model."""

    def named(values: Sequence[float]) -> Terms:
        with ERROR_MODELS.at_work(name):
            found = terms(values)
            _check_terms(found, count)
            return found

    return named
