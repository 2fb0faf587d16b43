"""Constitutive laws, one a file, found by looking in this folder."""

from skinlab.mechanics.materials.base import Law, Potential
from skinlab.mechanics.materials.registry import get_law, law_names

__all__ = ["Law", "Potential", "get_law", "law_names"]
