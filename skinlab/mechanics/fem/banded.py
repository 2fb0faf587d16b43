"""Symmetric positive definite matrices in a band, and their Cholesky factors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from skinlab.mechanics.fem.kernel import Kernel

Array = NDArray[np.float64]


class Factor(Protocol):
    """A Cholesky factor."""

    def solve(self, right: Array) -> Array:
        """Return the solution of a right side (n,), or those of several (k, n)."""
        ...


class Banded(Protocol):
    """A symmetric matrix of which a band is not zero."""

    @property
    def lower(self) -> Array:
        """(n, band + 1): column j holds K[j:j+band+1, j], LAPACK's lower band storage."""
        ...

    def factorise(self) -> Factor | None:
        """Return its Cholesky factor in its own place; None where it is not positive definite."""
        ...


@dataclass(frozen=True)
class LapackBanded:
    """By LAPACK."""

    lower: Array

    def factorise(self) -> LapackFactor | None:
        """See `Banded`."""
        from scipy.linalg import lapack  # slow to import

        factor, info = lapack.dpbtrf(self.lower.T, lower=1, overwrite_ab=1)
        return None if info else LapackFactor(factor)


@dataclass(frozen=True)
class LapackFactor:
    """By LAPACK."""

    columns: Array

    def solve(self, right: Array) -> Array:
        """See `Factor`."""
        from scipy.linalg import lapack  # slow to import

        return np.asarray(lapack.dpbtrs(self.columns, right.T, lower=1)[0].T)


class KernelBanded:
    """By the compiled loops. The memory goes back to the kernel with this object."""

    def __init__(self, kernel: Kernel, band: Array) -> None:
        """Take a band in the kernel's layout."""
        self.kernel, self.band = kernel, band

    def __del__(self) -> None:
        self.kernel.give_back(self.band)

    @property
    def lower(self) -> Array:
        """See `Banded`."""
        return self.kernel.lower(self.band)

    def factorise(self) -> KernelFactor | None:
        """See `Banded`."""
        inverse = self.kernel.factorise(self.band)
        return None if inverse is None else KernelFactor(self, inverse)


@dataclass(frozen=True)
class KernelFactor:
    """By the compiled loops."""

    of: KernelBanded
    inverse: Array

    def solve(self, right: Array) -> Array:
        """See `Factor`."""
        rows = np.atleast_2d(right)
        return self.of.kernel.solve(self.of.band, self.inverse, rows).reshape(right.shape)
