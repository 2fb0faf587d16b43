"""Find the inverse methods: every module of this folder that defines METHOD = (name, function)."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

import skinlab.identify as package
from skinlab.errors import InputError
from skinlab.identify.problem import Method


@cache
def _methods() -> dict[str, Method]:
    found: dict[str, Method] = {}
    for module_info in pkgutil.iter_modules(package.__path__):
        module = importlib.import_module(f"{package.__name__}.{module_info.name}")
        method: tuple[str, Method] | None = getattr(module, "METHOD", None)
        if method is not None:
            found[method[0]] = method[1]
    return found


def method_names() -> tuple[str, ...]:
    """Return the names of all methods, sorted."""
    return tuple(sorted(_methods()))


def get_method(name: str) -> Method:
    """Return the method of that name.

    Raises:
        InputError: there is none; the message lists those that there are.
    """
    try:
        return _methods()[name]
    except KeyError:
        known = ", ".join(method_names())
        raise InputError(f"method {name!r} is not known; expected one of: {known}") from None
