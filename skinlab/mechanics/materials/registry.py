"""Find the laws: every module of this folder that defines LAW."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import skinlab.mechanics.materials as package
from skinlab.errors import InputError
from skinlab.mechanics.materials.base import Law, check_law
from skinlab.plugins import find

DEFAULT_LAW = "extended_neo_hookean"  # where a model says no more


@cache
def _laws() -> dict[str, Law]:
    laws = {law.name: law for law in find(package, "LAW")}
    for law in laws.values():
        check_law(law)
    return laws


def law_names() -> tuple[str, ...]:
    """Return the names of all laws, sorted."""
    return tuple(sorted(_laws()))


def get_law(name: str = DEFAULT_LAW) -> Law:
    """Return the law of that name.

    Raises:
        InputError: there is none; the message lists those that there are.
    """
    try:
        return _laws()[name]
    except KeyError:
        known = ", ".join(law_names())
        raise InputError(f"law {name!r} is not known; expected one of: {known}") from None


@contextmanager
def with_law(law: Law) -> Iterator[Law]:
    """Put a law on this process's registry for a while: one that is in no file of this folder.

    Raises:
        ValueError: its declaration cannot work; says what is wrong.
    """
    check_law(law)
    laws = _laws()
    before = laws.get(law.name)
    laws[law.name] = law
    try:
        yield law
    finally:
        del laws[law.name]
        if before is not None:
            laws[law.name] = before
