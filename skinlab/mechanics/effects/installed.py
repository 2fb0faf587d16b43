"""What an installed effect returns, checked before anything is solved with it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.pressure_path import PressurePath
from skinlab.mechanics.fem.skin import Layer, Prony, Skin, SkinProblem, Term
from skinlab.mechanics.fem.suction import Geometry
from skinlab.mechanics.materials import Energy
from skinlab.plugins import above_zero, finite, zero_or_more

Array = NDArray[np.float64]

_HUGE = 1e9  # mm and s; squares of residuals overflow far above
_LISTS = {"terms": Term, "above": Layer, "below": Layer, "prony": Prony}
_NUMBERS = ("stretch", "slip_mm", "stiffness", "preload_mbar")


def check_problem(found: object) -> None:
    """Check the mechanical problem: what its types say, since compiled loops ask no more.

    Raises:
        TypeError, ValueError: it is none.
    """
    if not isinstance(found, SkinProblem):
        raise TypeError(f"change returned a {type(found).__name__}; expected a SkinProblem")
    for name, wanted in (("geometry", Geometry), ("skin", Skin)):
        one: object = getattr(found, name)
        if not isinstance(one, wanted):
            raise TypeError(f"{name} is a {type(one).__name__}; expected a {wanted.__name__}")
    for name in _NUMBERS:
        finite(name, getattr(found, name))
    for name, kind in _LISTS.items():
        given: object = getattr(found, name)
        if not isinstance(given, tuple) or not all(isinstance(one, kind) for one in given):
            raise TypeError(f"{name} is {given!r}; expected a tuple of {kind.__name__}")
    for layer in (*found.above, *found.below):
        for name in ("thickness_mm", "half_shear_mpa", "kappa_mpa"):
            above_zero(f"{name} of a layer", getattr(layer, name))
    for relaxing in found.prony:
        zero_or_more("g", relaxing.g)
        above_zero("tau_s", relaxing.tau_s)
    for term in found.terms:
        _check_term(term)
    hash(found)  # it is a key of caches


def _check_term(term: Term) -> None:
    law: object = term.law
    if not isinstance(law, Energy):
        raise TypeError(f"law of a term is a {type(law).__name__}; expected an Energy")
    given: object = term.parameters
    pairs = isinstance(given, tuple) and all(isinstance(p, tuple) and len(p) == 2 for p in given)
    if not pairs:
        raise TypeError(
            f"parameters of a term are {given!r}; expected pairs of a name and a number"
        )
    for name, value in term.parameters:
        finite(f"{name} of a term", value)
    if missing := set(law.parameter_names) - {name for name, _ in term.parameters}:
        raise ValueError(f"parameters of a term lack {', '.join(sorted(missing))}")


def check_path(found: object) -> None:
    """Check the suction that is felt.

    Raises:
        TypeError: it is no path.
    """
    if not isinstance(found, PressurePath):
        raise TypeError(f"felt returned a {type(found).__name__}; expected a PressurePath")
    for name in ("time_s", "pressure_mbar"):
        given: object = getattr(found, name)
        if not isinstance(given, tuple):  # it is a key of caches
            raise TypeError(f"{name} of the path is a {type(given).__name__}; expected a tuple")


def check_series(what: str, found: object, shape: tuple[int, ...], given: Array) -> None:
    """Check what an installed effect makes of a series: as long, and finite where that is."""
    if not isinstance(found, np.ndarray) or found.shape != shape:
        got = getattr(found, "shape", None)
        told = type(found).__name__ if got is None else f"an array of the shape {got}"
        raise TypeError(f"{what} returned {told}; expected an array of the shape {shape}")
    if found.dtype.kind not in "fiu":
        raise TypeError(f"{what} returned an array of {found.dtype}; expected numbers")
    if not ((np.abs(found) < _HUGE) | ~np.isfinite(given)).all():
        raise ValueError(f"{what} returned a value that is not finite, or beyond {_HUGE:g}")
