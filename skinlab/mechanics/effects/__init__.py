"""Missing effects, one a file, found by looking in this folder."""

from skinlab.mechanics.effects.base import Effect, Parameter
from skinlab.mechanics.effects.registry import all_effects, effect_names, get_effect

__all__ = ["Effect", "Parameter", "all_effects", "effect_names", "get_effect"]
