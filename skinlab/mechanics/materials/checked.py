"""What an installed law answers, checked: errors name the law and the package that it is from.

Types and shapes are looked at in every call, numbers at rest and at small strains: an energy may
well overflow at a strain that a solver only tries.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinlab.plugins import AtWork

Array = NDArray[np.float64]

_SMALL = 0.01  # strain up to which every law has an energy


def told(who: str) -> AtWork:
    """Name an installed law that breaks down while this lasts.

    Raises:
        BrokenPluginError: it did.
        InputError: it refuses its parameters.
    """
    return AtWork(lambda: who, lambda: who)


def check_arrays(
    named: Iterable[tuple[str, object]], given: Sequence[Any], parameters: Mapping[str, Any]
) -> None:
    """Check that values are numbers, in the shape of what they were computed from.

    Raises:
        TypeError: one is not.
    """
    shape = np.broadcast_shapes(*(np.shape(x) for x in (*given, *parameters.values())))
    for name, value in named:
        array = np.asarray(value)
        if array.dtype.kind not in "fiu" or isinstance(value, list | tuple):
            got = f"an array of {value.dtype}" if isinstance(value, np.ndarray) else None
            raise TypeError(
                f"{name} is {got or f'a {type(value).__name__}'}; expected an array of numbers"
            )
        if array.shape != shape and not _fits(array.shape, shape):
            raise TypeError(f"{name} has the shape {array.shape}; expected {shape}")


def _fits(got: tuple[int, ...], shape: tuple[int, ...]) -> bool:
    try:
        return np.broadcast_shapes(got, shape) == shape
    except ValueError:
        return False


def check_modulus(found: object, values: Mapping[str, Any]) -> None:
    """Check half of a shear modulus at rest, of these parameters.

    Raises:
        TypeError, ValueError: it is no number above 0.
    """
    check_arrays([("half_shear_modulus", found)], (), values)
    moduli = np.asarray(found, dtype=float)
    if all(np.isfinite(v).all() for v in values.values()) and not (moduli > 0.0).all():
        worst = moduli[~(moduli > 0.0)][0]
        raise ValueError(f"half_shear_modulus is {worst:g} MPa; expected more than 0")


def small_strains() -> tuple[Array, Array, Array]:
    """Return the invariants I1, I2 and J at rest, and of small stretches in all ways."""
    a, b, c = (x.ravel() for x in np.meshgrid(*[1.0 + _SMALL * np.array([-1.0, 0.0, 1.0])] * 3))
    i1, i2 = a**2 + b**2 + c**2, (a * b) ** 2 + (b * c) ** 2 + (c * a) ** 2
    return i1, i2, a * b * c


def check_numbers(named: Iterable[tuple[str, Any]]) -> None:
    """Check that values at small strains are finite.

    Raises:
        ValueError: one is not.
    """
    for name, value in named:
        if not np.isfinite(value).all():
            wrong = np.ravel(value)[np.argmin(np.isfinite(np.ravel(value)))]
            raise ValueError(
                f"{name} is {wrong} at a strain below {2 * _SMALL:g}; expected a finite number"
            )
