"""The stored points of the sequence are scipy's.

They were made by `np.savez(FILE, **{f"d{d}": sobol_points(128, d) for d in range(1, 9)})`.
"""

from pathlib import Path

import numpy as np

import skinlab
from skinlab.inference.error_choice import sobol_points

FILE = Path(skinlab.__file__).parent / "data" / "sobol.npz"


def test_the_stored_points_are_the_sequences():
    with np.load(FILE) as stored:
        assert sorted(stored) == [f"d{d}" for d in range(1, 9)]
        for name in stored:
            np.testing.assert_array_equal(stored[name], sobol_points(128, int(name[1:])))


def test_fewer_points_are_the_first_ones():
    np.testing.assert_array_equal(sobol_points(19, 3), sobol_points(128, 3)[:19])
