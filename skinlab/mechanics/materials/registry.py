"""Find the laws: every module of this folder that defines LAW."""

from __future__ import annotations

from functools import cache

import skinlab.mechanics.materials as package
from skinlab.errors import InputError
from skinlab.mechanics.materials.base import Law
from skinlab.plugins import find


@cache
def _laws() -> dict[str, Law]:
    return {law.name: law for law in find(package, "LAW")}


def law_names() -> tuple[str, ...]:
    """Return the names of all laws, sorted."""
    return tuple(sorted(_laws()))


def get_law(name: str) -> Law:
    """Return the law of that name.

    Raises:
        InputError: there is none; the message lists those that there are.
    """
    try:
        return _laws()[name]
    except KeyError:
        known = ", ".join(law_names())
        raise InputError(f"law {name!r} is not known; expected one of: {known}") from None
