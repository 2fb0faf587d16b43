"""Domes from the table: compiled where there is a library, and the same without."""

from __future__ import annotations

import numpy as np
import pytest

from skinlab.discrepancy.table_domes import TableDomes
from skinlab.mechanics.fem import kernel
from skinlab.mechanics.fem.skin import Skin, SkinProblem
from skinlab.mechanics.fem.suction import Geometry


@pytest.mark.parametrize("alike", [True, False], ids=["one top", "tops of their own"])
@pytest.mark.parametrize("rows", [1, 4])
def test_the_compiled_domes_are_those_of_numpy(table, monkeypatch, alike, rows):
    """Below zero, up to and beyond the highest suction, where it goes on straight."""
    each = ((0.02, 0.5, 0.3), (0.03, 0.2, 0.45), (0.05, 3.0, 0.2), (0.06, 0.1, 0.48))
    problems = [SkinProblem(Geometry(6.0, 1.2), Skin(values)) for values in each]
    tops = [120.0] * 4 if alike else [100.0, 130.0, 160.0, 190.0]
    suctions = np.random.default_rng(1).uniform(-20.0, 250.0, (rows, 150))
    suctions[0, 7] = np.nan

    def found():
        return TableDomes(table)(problems, tops)(suctions)

    compiled = found()
    assert kernel.library() is not None
    monkeypatch.setattr(kernel, "library", lambda: None)
    with np.errstate(invalid="ignore"):
        expected = found()
    assert np.isnan(compiled).sum() == np.isnan(expected).sum() >= (1 if rows > 1 else 4)
    np.testing.assert_allclose(compiled, expected, rtol=1e-12)


def test_beyond_the_ends_a_dome_is_straight(table):
    problem = SkinProblem(Geometry(6.0, 1.2), Skin((0.03, 0.6, 0.3)))
    dome = TableDomes(table)([problem], [100.0])
    below = dome(np.array([[-32.0, -26.0, -20.0]]))[0]
    assert below[1] == pytest.approx(0.5 * (below[0] + below[2]), rel=1e-12)
    above = dome(np.array([[101.0, 121.0, 141.0]]))[0]
    assert above[1] == pytest.approx(0.5 * (above[0] + above[2]), rel=1e-12)
