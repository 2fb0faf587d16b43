"""Find the inverse methods: every module of this folder that defines METHOD = (name, function)."""

from __future__ import annotations

from functools import cache

import skinlab.inference.methods as package
from skinlab.errors import InputError
from skinlab.inference.problem import Method
from skinlab.plugins import find


@cache
def _methods() -> dict[str, Method]:
    return dict(find(package, "METHOD"))


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
