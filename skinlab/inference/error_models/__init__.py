"""Error models, one a file, found by looking: every module here that defines ERROR_MODEL."""

from __future__ import annotations

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
        part.is_process  # noqa: B018 -- its terms are asked for, which may break down as well
    except Exception as error:  # noqa: BLE001 -- no plugin may end what others can answer
        warn(f"{who}: broke down, and is left out: {type(error).__name__}: {error}")
        return None
    return replace(part, terms=_named(model.name, part.terms))


def _named(name: str, terms: Callable[[Sequence[float]], Terms]) -> Callable[..., Terms]:
    """Return the terms, whose errors name the model."""

    def named(values: Sequence[float]) -> Terms:
        with ERROR_MODELS.at_work(name):
            return terms(values)

    return named
