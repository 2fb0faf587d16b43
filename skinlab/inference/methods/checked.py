"""What an installed method answers, checked before anything is computed from it."""

from __future__ import annotations

import math
from numbers import Integral, Real

import numpy as np

from skinlab.inference.problem import Estimate
from skinlab.parameters import ParameterSpace

_SLACK = 1e-6  # of the unit cube: an end may be rounded


def checked_estimate(estimate: object, space: ParameterSpace) -> Estimate:
    """Return what a method answers for a problem in this space.

    Raises:
        TypeError, ValueError: it is no answer; says what is wrong, and what was expected.
    """
    if not isinstance(estimate, Estimate):
        raise TypeError(f"it returned a {type(estimate).__name__}; expected an Estimate")
    count = len(space.names)
    found = _numbers("parameters", estimate.parameters, (count,))
    unit = np.asarray(space.to_unit(found))
    for name, value, at in zip(space.names, found, unit, strict=True):
        if not -_SLACK <= at <= 1.0 + _SLACK:
            low, high = (ends[space.names.index(name)] for ends in space.bounds)
            raise ValueError(f"{name} is {value:g}; expected {low:g} to {high:g}")
    error_um: object = estimate.error_um
    if not isinstance(error_um, Real) or not math.isfinite(error_um):
        raise ValueError(f"its error_um is {error_um}; expected a finite number")
    if float(error_um) < 0.0:
        raise ValueError(f"its error_um is {error_um}; expected 0 or more")
    for name in ("iterations", "evaluations"):
        number: object = getattr(estimate, name)
        if not isinstance(number, Integral) or int(number) < 0:
            raise TypeError(f"its {name} are {number!r}; expected an int, 0 or more")
    converged: object = estimate.converged
    if not isinstance(converged, bool | np.bool_):  # a text "no" is true
        raise TypeError(f"its converged is {converged!r}; expected True or False")
    minima = estimate.minima
    if minima is not None:
        minima = _numbers("minima", minima, (*np.shape(minima)[:1], count))
        if len(minima) and not (minima.min() >= -_SLACK and minima.max() <= 1.0 + _SLACK):
            raise ValueError("its minima lie outside of the unit cube; expected 0 to 1")
    return Estimate(
        found,
        float(error_um),
        int(estimate.iterations),
        int(estimate.evaluations),
        bool(estimate.converged),
        minima,
    )


def _numbers(name: str, value: object, shape: tuple[int, ...]) -> np.ndarray:
    """Return an array of finite numbers in this shape.

    Raises:
        TypeError, ValueError: it is none.
    """
    array = np.asarray(value)
    if array.shape != shape:
        raise TypeError(f"its {name} have the shape {array.shape}; expected {shape}")
    if array.dtype.kind not in "fiu":
        raise TypeError(f"its {name} are of the type {array.dtype}; expected numbers")
    finite = np.isfinite(array)
    if not finite.all():
        raise ValueError(f"its {name} hold {array[~finite][0]}; expected finite numbers")
    return array.astype(float)
