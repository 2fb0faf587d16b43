"""Constitutive laws, one a file, found by looking: every module here that defines LAW."""

from skinlab.mechanics.materials.base import Law, Potential, check_law
from skinlab.plugins import Registry

LAWS: Registry[Law] = Registry("law", __name__, "LAW", "skinlab.laws", check_law)

get_law, law_names = LAWS.get, LAWS.names

__all__ = ["LAWS", "Law", "Potential", "get_law", "law_names"]
