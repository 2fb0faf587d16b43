"""What an installed effect returns, checked before anything is solved with it."""

from __future__ import annotations

import math
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from skinlab.curves.pressure_path import PressurePath
from skinlab.mechanics.fem.skin import Layer, Prony, SkinProblem, Term

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
    for name in _NUMBERS:
        _check_number(name, getattr(found, name))
    for name, kind in _LISTS.items():
        given: object = getattr(found, name)
        if not isinstance(given, tuple) or not all(isinstance(one, kind) for one in given):
            raise TypeError(f"{name} is {given!r}; expected a tuple of {kind.__name__}")
    for layer in (*found.above, *found.below):
        for name in ("thickness_mm", "half_shear_mpa", "kappa_mpa"):
            _check_number(f"{name} of a layer", getattr(layer, name), above_zero=True)
    for term in found.prony:
        _check_number("g", term.g)
        _check_number("tau_s", term.tau_s, above_zero=True)
    hash(found)  # it is a key of caches


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


def _check_number(name: str, value: object, *, above_zero: bool = False) -> None:
    wanted = "a number above 0" if above_zero else "a finite number"
    if not isinstance(value, Real) or not math.isfinite(value):
        raise ValueError(f"{name} is {value!r}; expected {wanted}")
    if above_zero and float(value) <= 0.0:
        raise ValueError(f"{name} is {value!r}; expected {wanted}")


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
