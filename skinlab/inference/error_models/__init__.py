"""Error models, one a file, found by looking: every module here that defines ERROR_MODEL."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

from drivers.breakdown import reason
from skinlab.plugins import Registry, needs, texts, warn

if TYPE_CHECKING:
    from skinlab.inference.error_models.base import ErrorModel, Look, Part

A = TypeVar("A")
R = TypeVar("R")


def check_error_model(one: object) -> None:
    """Check that an extension is an error model.

    Raises:
        TypeError: it is not.
    """
    needs(one, "meaning", "prior", "part")
    texts(one, "meaning", "prior")
    if "+" in one.name:  # type: ignore[attr-defined]
        raise TypeError("its name has a + in it, which joins the names of combinations")
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
    from skinlab.inference.error_models.checked import checked_part, own_look  # slow

    try:
        part: object = model.part(own_look(look))
        if part is None:
            return None
        return _named(checked_part(model.name, part, len(look.samples)))
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # noqa: BLE001 -- no plugin may end others' answers
        warn(f"{who}: broke down, and is left out: {reason(error)}")
        return None


def _named(part: Part) -> Part:
    """Return a part whose functions name the model where they break down later."""

    def named(function: Callable[[A], R]) -> Callable[[A], R]:
        def at_work(given: A) -> R:
            with ERROR_MODELS.at_work(part.name):
                return function(given)

        return at_work

    again = part.again
    return replace(
        part,
        terms=named(part.terms),
        variances=None if part.variances is None else named(part.variances),
        size_um=None if part.size_um is None else named(part.size_um),
        again=None if again is None else named(lambda square: _named(again(square))),
    )
