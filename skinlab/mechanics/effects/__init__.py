"""Missing effects, one a file, found by looking: every module here that defines EFFECT."""

from __future__ import annotations

from collections.abc import Mapping

from skinlab.mechanics.effects.base import Effect, Parameter, check_effect
from skinlab.plugins import Registry

EFFECTS: Registry[Effect] = Registry(
    "effect", __name__, "EFFECT", "skinlab.effects", check_effect, called="effects.{}".format
)

all_effects, effect_names, get_effect = EFFECTS.all, EFFECTS.names, EFFECTS.get


def library_names() -> list[str]:
    """Return the effects that have a name of their own: all but the learned ones."""
    return [one.name for one in all_effects() if not one.family]


def checked(effects: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    """Return the effects with all their values, in the order of their names.

    Raises:
        InputError: an effect or a parameter is not known, missing or out of bounds.
    """
    return {name: get_effect(name).full(effects[name]) for name in sorted(effects)}


__all__ = [
    "EFFECTS",
    "Effect",
    "Parameter",
    "all_effects",
    "checked",
    "effect_names",
    "get_effect",
    "library_names",
]
