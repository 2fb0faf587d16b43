"""Find the laws: every module of this folder that defines LAW."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

import skinlab.materials as package
from skinlab.errors import InputError
from skinlab.materials.base import Law


@cache
def _laws() -> dict[str, Law]:
    found: dict[str, Law] = {}
    for module_info in pkgutil.iter_modules(package.__path__):
        module = importlib.import_module(f"{package.__name__}.{module_info.name}")
        law: Law | None = getattr(module, "LAW", None)
        if law is not None:
            found[law.name] = law
    return found


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
