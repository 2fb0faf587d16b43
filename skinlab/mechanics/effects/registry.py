"""Find the effects: every module of this folder that defines EFFECT."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import skinlab.mechanics.effects as package
from skinlab.errors import InputError
from skinlab.mechanics.effects.base import Effect
from skinlab.plugins import find


@cache
def _effects() -> dict[str, Effect]:
    return {effect.name: effect for effect in find(package, "EFFECT")}


def effect_names() -> tuple[str, ...]:
    """Return the names of all effects, sorted."""
    return tuple(sorted(_effects()))


def all_effects() -> tuple[Effect, ...]:
    """Return all effects, in the order of their names."""
    return tuple(_effects()[name] for name in effect_names())


def get_effect(name: str) -> Effect:
    """Return the effect of that name.

    Raises:
        InputError: there is none; the message lists those that there are.
    """
    try:
        return _effects()[name]
    except KeyError:
        known = ", ".join(effect_names())
        raise InputError(f"effects.{name} is not known; expected one of: {known}") from None


def checked(effects: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    """Return the effects with all their values, in the order of their names.

    Raises:
        InputError: an effect or a parameter is not known, missing or out of bounds.
    """
    return {name: get_effect(name).full(effects[name]) for name in sorted(effects)}
