"""Tridiagonal covariances by their bidiagonal factors, in time that grows with their size.

By the compiled kernel, or by LAPACK where there is none: scipy takes longer to import than a curve
takes to identify.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from skinlab.mechanics.fem import kernel

Array = NDArray[np.float64]


def factorise(diagonal: Array, beside: Array) -> tuple[Array, Array]:
    """Return d (n,) and e (n − 1,): the matrix is L diag(d) Lᵀ, with e below L's diagonal of ones.

    Raises:
        numpy.linalg.LinAlgError: the matrix is not positive definite.
    """
    found = kernel.factorise_tridiagonal(diagonal, beside)
    if found is None:
        from scipy.linalg.lapack import dpttrf

        found = dpttrf(diagonal, beside)
    d, below, failed = found
    if failed:
        raise np.linalg.LinAlgError("the covariance of the errors is not positive definite")
    return d, below


def solve(below: Array, right: Array, trans: Literal["N", "T"] = "N") -> Array:
    """Return x with x₀ = r₀ and xᵢ + belowᵢ₋₁ xᵢ₋₁ = rᵢ, for right sides (n, m).

    With `trans` "T" that of the transposed matrix.
    """
    if len(right) < 2 or not right.shape[1]:
        return right  # nothing to do, and LAPACK's wrapper does not bear it
    found = kernel.solve_bidiagonal(below, right, transposed=trans == "T")
    if found is None:
        from scipy.linalg.lapack import dtbtrs

        band = np.ones((2, len(right)))
        band[1, :-1] = below
        found, _ = dtbtrs(band, right, uplo="L", trans=trans, diag="U")
    return np.asarray(found)
