"""Constitutive laws, one a file, found by looking in this folder."""

from skinlab.mechanics.materials.base import Energy, Law, Potential
from skinlab.mechanics.materials.registry import DEFAULT_LAW, get_law, law_names

__all__ = ["DEFAULT_LAW", "Energy", "Law", "Potential", "get_law", "law_names"]
