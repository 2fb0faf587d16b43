"""What readers call the parameters of laws and effects, from their declarations.

A name carries its unit, so that two laws which share one mean the same quantity by it.
"""

from __future__ import annotations

from collections.abc import Iterable

from skinlab.mechanics.effects import all_effects
from skinlab.mechanics.materials import DEFAULT_LAW, get_law, law_names
from skinlab.parameters import Parameter


def parameter_names() -> list[str]:
    """Return the parameters of all laws, those of the default one first."""
    laws = (get_law(name) for name in (DEFAULT_LAW, *law_names()))
    return list(dict.fromkeys(name for law in laws for name in law.names))


def parameter_of(name: str) -> Parameter | None:
    """Return the declaration of a law's parameter or of `EFFECT.PARAMETER`; None: not known."""
    effect, _, parameter = name.rpartition(".")
    if effect:
        for one in all_effects():
            if one.name == effect:
                return next((p for p in one.parameters if p.name == parameter), None)
        return None
    for law in (DEFAULT_LAW, *law_names()):
        for declared in get_law(law).parameters:
            if declared.name == name:
                return declared
    return None


def effect_words(effect: str) -> str:
    """Return an effect's name with what it means: pressure_lag (the channels are not …)."""
    found = next((one.meaning for one in all_effects() if one.name == effect), "")
    return f"{effect} ({found})" if found else effect


def is_effects(name: str) -> bool:
    """Return whether it is an effect's parameter."""
    return "." in name


def label(name: str) -> str:
    """Return how a report calls it: X1, ν; the name itself of what is not a law's."""
    found = None if is_effects(name) else parameter_of(name)
    return name if found is None else found.label


def heading(name: str) -> str:
    """Return the label with its unit: X1 (MPa)."""
    found = None if is_effects(name) else parameter_of(name)
    return name if found is None else found.heading


def plain(name: str) -> tuple[str, str]:
    """Return name and unit for a terminal: (X1, MPa), (ν, ""), (pressure_lag lag, s)."""
    found = parameter_of(name)
    if found is None:
        return name, ""
    effect = name.rpartition(".")[0]
    return f"{effect} {found.label}".lstrip(), found.unit


def unit_of(name: str) -> str:
    """Return the unit; empty where it has none."""
    found = parameter_of(name)
    return "" if found is None else found.unit


def beyond_zero(name: str, value: float) -> float:
    """Return how far a value is from the one that is no effect: 0.025 of a stretch of 1.025."""
    found = parameter_of(name)
    return abs(value - ((found.zero if found is not None else None) or 0.0))


def is_logarithmic(name: str) -> bool:
    """Return whether fits look for it, and people scatter, evenly in its logarithm."""
    found = parameter_of(name)
    if found is None:
        return False
    return found.spacing == "log" if found.search is None else found.search.transform != "linear"


def is_poisson(name: str) -> bool:
    """Return whether it is a law's Poisson's ratio."""
    return any(get_law(law).poisson == name for law in law_names())


def of_law(results: Iterable[Iterable[str]]) -> tuple[str, ...]:
    """Return the law's parameters among the names in results; where there are none, the default's.

    Results of several laws: all of their parameters.
    """
    known = {p.name for law in law_names() for p in get_law(law).parameters}
    found = dict.fromkeys(name for names in results for name in names if name in known)
    return tuple(found) or get_law().names
