"""Constitutive laws, one a file, found by looking: every module here that defines LAW."""

from skinlab.mechanics.materials.base import Energy, Law, Potential, adopt_law, check_law
from skinlab.plugins import Registry

DEFAULT_LAW = "extended_neo_hookean"  # where a model says no more

LAWS: Registry[Law] = Registry("law", __name__, "LAW", "skinlab.laws", check_law, adopt=adopt_law)

law_names, with_law = LAWS.names, LAWS.lent


def get_law(name: str = DEFAULT_LAW) -> Law:
    """Return the law of that name.

    Raises:
        InputError: there is none; the message lists those that there are.
    """
    return LAWS.get(name)


__all__ = ["DEFAULT_LAW", "LAWS", "Energy", "Law", "Potential", "get_law", "law_names", "with_law"]
